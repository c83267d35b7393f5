"""Configuration of a whole-arm rehearsal."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from mpm.errors import say_unknown
from mpm.geometry.rigid_motion import Pose
from robosim.base.resources import config_path
from robosim.config import bounds
from robosim.config.arm import ArmConfig, ArmServo, Grip, GripperConfig
from robosim.config.motion import DoseConfig, JointTrajectoryConfig, MotionLimitsConfig
from robosim.config.scene import ObstacleConfig, RegionConfig
from robosim.config.scene_config import SceneConfig
from robosim.config.settings import Setting
from robosim.config.table import Placement, Table, Vector3, load

APPROACH = "approach"
"""Name of the waypoint from which a hand approaches a tool that it picks up."""
RETREAT = "retreat"
"""Name of the waypoint to which it goes back from a tool that it has set down."""


class PathConfig(Table):
    """How the tool rounds the corners between waypoints."""

    acceleration: bounds.Acceleration = 2.0
    """Acceleration of the tool along the path [m/s^2]."""
    angular_acceleration: bounds.AngularAcceleration = 10.0
    """Angular acceleration of the tool along the path [rad/s^2]."""
    corner_tolerance: bounds.Tolerance = 1.5e-3
    """Largest distance [m] between the rounded path and the screw motions inside a container."""


class WaypointConfig(Table):
    """A pose of the tool, reached by a screw motion from the waypoint before."""

    name: bounds.Name
    """Its name in reports and errors."""
    frame: bounds.Name
    """Frame of position and rotation: "world", or the name of a container."""
    position: Vector3
    """Position of the tool's frame [m]."""
    rotation_deg: tuple[bounds.Angle, bounds.Angle, bounds.Angle] = (0.0, 0.0, 0.0)
    """Rotations about the frame's x, then y, then z axis [deg]."""
    speed: bounds.Speed
    """Speed of the tool on the way to this waypoint [m/s]."""
    angular_speed: bounds.AngularSpeed = 1.5
    """Angular speed on the way to this waypoint [rad/s]; the slower of the two decides."""
    stop: bool = False
    """Whether the tool stops there."""
    dwell: bounds.Duration = 0.0
    """Duration [s] of the stop."""
    acceleration: bounds.Acceleration | None = None
    """Acceleration [m/s^2] in the rounded corner, or before and after the stop; null: path.acceleration."""


class PickConfig(Table):
    """The tool stands at the first waypoint, and the hand picks it up there."""

    approach: Annotated[float, Field(gt=0.0, le=1.0)] = 0.12
    """Distance [m] from which the open hand comes, along its approach direction."""
    set_down: bool = False
    """Whether the hand opens at the last waypoint, where the tool then stands, and goes back by that distance."""


class RehearsalConfig(SceneConfig):
    """A whole-arm rehearsal. Paths in the file are relative to it."""

    grasp: Grip = "weld"
    """weld: fixed in the hand; friction: held by the fingers alone."""
    tool_container: Annotated[list[Literal["contact", "sdf"]], Field(max_length=2)] = ["contact", "sdf"]  # noqa: RUF012
    """How collisions of tool and containers are detected. contact: MuJoCo contacts, which exert forces; sdf: points of
    the container with a negative signed distance to the tool."""
    host_dt: Annotated[float, Field(ge=1e-5, le=2e-3)] = 1e-3
    """MuJoCo step [s], and the time by which the grains advance at once."""
    grasp_time: bounds.GraspTime = 0.5
    """Time [s] for the fingers to close before the arm moves."""
    area: RegionConfig | None = None
    """Target region of the material, if the target is not a container."""
    limits: MotionLimitsConfig = MotionLimitsConfig()
    servo: ArmServo | None = None
    """Gains of the joints; null: the robot's."""
    path: PathConfig = PathConfig()
    joint_trajectory: JointTrajectoryConfig = JointTrajectoryConfig()
    waypoints: Annotated[tuple[WaypointConfig, ...], Field(min_length=2, max_length=bounds.MAX_ENTRIES)]
    """Poses of the tool, in order."""
    weigh_at: bounds.Name | None = None
    """Waypoint with a dwell, where the wrist sensor weighs the load; the grains in the tool count as scooped. null: no
    weighing, all grains count."""
    least_load: bounds.Mass = 0.0
    """Smallest accepted mass [kg] of the load."""
    robot: bounds.FilePath | ArmConfig = "iiwa14"
    """Name of an arm of models/robots, the path of a .yaml file of one's own, or a table with its keys."""
    gripper: bounds.FilePath | GripperConfig | None = None
    """Name of a hand of models/grippers, the path of a .yaml file, a table, or none: the tool is bolted to the flange;
    null: the robot's usual hand."""
    base: Placement | None = None
    """Where the arm's base stands; null: where the robot's file says."""
    grip_turn_deg: bounds.Angle | None = None
    """Turn of the tool in the hand about its handle [deg]; null: the planner chooses, 0 where that can be followed."""
    max_time_scale: Annotated[float, Field(ge=1.0, le=10.0)] = 1.0
    """Largest factor by which the whole motion is played slower where the arm is too slow for the waypoints' speeds; 1:
    refuse such a motion."""
    pick: PickConfig | None = None
    """Whether the tool is picked up; null: the hand holds it from the start."""
    workcell: bounds.FilePath | None = None
    """MJCF file of table, floor, lights and cameras, in place of the bundled ones; planning and contacts respect its
    colliding geoms. The grains lie on the plane z = 0 all the same."""
    obstacles: Annotated[tuple[ObstacleConfig, ...], Field(max_length=bounds.MAX_ENTRIES)] = ()
    """What stands in the robot's way; grains pass through it."""
    trajectory: Literal["script", "recorded"] = "script"
    """script: follow the waypoints; recorded: follow the recorded motions of the sub-tasks in `recorded`."""
    dose: DoseConfig | None = None
    """A mass that a controller doses into the empty container, on a balance; null: none."""
    recorded: Annotated[tuple[bounds.Name, ...], Field(max_length=bounds.MAX_ENTRIES)] = ()
    """Sub-tasks whose recorded motions are joined, in order."""
    motions: bounds.FilePath | None = None
    """Folder with a motion of each sub-task as TASK.npz; null: the bundled motions."""

    @property
    def advance_dt(self) -> float:
        return self.host_dt

    def check(self) -> None:
        super().check()
        filled = [c.fill_height > 0 for c in self.containers.values()]
        givers = any(filled) + (self.pile is not None) + (self.tool_fill_height is not None)
        if givers != 1:
            raise ValueError(f"{givers} kinds of places hold material at the start; accepted: one of containers with a "
                             f"fill_height, pile, tool_fill_height")
        takers = (False in filled) + (self.area is not None)
        if takers != 1:
            raise ValueError(f"{takers} kinds of places take material; accepted: one of containers without "
                             f"fill_height, area")
        if self.pile is not None and (self.pile.round or min(self.pile.half) <= 0):
            raise ValueError(f"pile: half {self.pile.half}, round: {self.pile.round}; accepted: above 0, a block")
        if self.sources and self.weigh_at is None:
            raise ValueError("weigh_at: missing; a tool that is filled is weighed at a waypoint with a dwell")
        if self.trajectory == "recorded" and not self.recorded:
            raise ValueError("trajectory: recorded needs `recorded`, a list of sub-tasks")
        if self.pick is not None and (self.grasp != "friction" or self.trajectory != "script"):
            raise ValueError(f"pick with grasp: {self.grasp}, trajectory: {self.trajectory}; accepted: friction, "
                             f"script")
        if self.pick is not None and self.gripper == "none":
            raise ValueError("pick with gripper: none; accepted: a gripper")
        self._check_path()
        self._check_dose()

    def _check_path(self) -> None:
        names = [w.name for w in self.waypoints]
        if len(set(names)) != len(names):
            raise ValueError(f"waypoints: names repeat: {sorted({n for n in names if names.count(n) > 1})}")
        if self.trajectory == "script" and self.weigh_at is not None:
            if self.weigh_at not in names:
                raise ValueError(f"weigh_at: {say_unknown('waypoint', self.weigh_at, names)}")
            if next(w for w in self.waypoints if w.name == self.weigh_at).dwell < 0.2:
                raise ValueError(f"weigh_at: waypoint {self.weigh_at!r} needs a dwell of 0.2 s or more")
        for w in self.waypoints:
            if w.frame not in ("world", *self.containers):
                raise ValueError(f"waypoint {w.name!r}: {say_unknown('frame', w.frame, ['world', *self.containers])}")
            if w.dwell and not w.stop:
                raise ValueError(f"waypoint {w.name!r}: dwell = {w.dwell} s needs stop: true")
        walls = self.solid_wall / (cell := self.field.cell)  # half a cell for a shell
        if not 0.5 - 1e-9 <= walls <= 1.0 + 1e-9:
            raise ValueError(f"tool_wall = {self.tool_wall} m is {walls:.2f} cells of {cell} m; accepted: 0.5 to 1, "
                             f"{0.5 * cell:g} to {cell:g} m (a thinner wall leaks, a thicker one distorts the "
                             f"{self.tool_name})")
        if self.field.dt is not None and abs(self.host_dt / self.field.dt - round(self.host_dt / self.field.dt)) > 1e-6:
            raise ValueError(f"field.dt = {self.field.dt} s divides host_dt = {self.host_dt} s "
                             f"{self.host_dt / self.field.dt:.4f} times; accepted: a whole number")
        if not self.waypoints[0].stop or not self.waypoints[-1].stop:
            raise ValueError("waypoints: the first and the last need stop: true")

    def tool_pose(self, waypoint: WaypointConfig) -> Pose:
        """Return the world pose of the tool's frame at a waypoint."""
        local = Placement(position=waypoint.position, rotation_deg=waypoint.rotation_deg).pose
        return local if waypoint.frame == "world" else self.containers[waypoint.frame].pose @ local

    @property
    def standing_pose(self) -> Pose | None:
        """World pose at which a tool that is picked up stands; None where none is."""
        if self.pick is None:
            return None
        return self.tool_pose(next(waypoint for waypoint in self.waypoints if waypoint.name != APPROACH))

    @property
    def dose_at(self) -> str:
        """Name of the waypoint at which the dose begins; empty where nothing is dosed."""
        if self.dose is None:
            return ""
        at = self.dose.at
        return at if isinstance(at, str) else self.waypoints[at].name

    def _check_dose(self) -> None:
        if self.dose is None:
            return
        names, at = [w.name for w in self.waypoints], self.dose.at
        if at not in names and not (isinstance(at, int) and 0 < at < len(names) - 1):
            also = f"or a number of 1 to {len(names) - 2}"
            raise ValueError(f"dose.at: {say_unknown('waypoint', at, names[1:-1], also)}")
        index = names.index(self.dose_at)
        waypoint = self.waypoints[index]
        if not waypoint.stop or not 0 < index < len(names) - 1:
            raise ValueError(f"dose.at: waypoint {waypoint.name!r}; accepted: one with stop: true, neither the first "
                             f"nor the last")
        if self.weigh_at is not None and names.index(self.weigh_at) > index:
            raise ValueError(f"weigh_at: waypoint {self.weigh_at!r} comes after the dose at {waypoint.name!r}; "
                             f"accepted: one before it")
        if self.tool_wall != "shell" or not self.sinks or self.trajectory != "script":
            raise ValueError(f"dose with tool_wall: {self.tool_wall}, empty containers: "
                             f"{', '.join(self.sinks) or 'none'}, trajectory: {self.trajectory}; accepted: shell (a "
                             f"load sinks into solid walls), one or more, script")
        cup = self.dose.cup
        if (cup is None and len(self.sinks) > 1) or (cup is not None and cup not in self.sinks):
            raise ValueError(f"dose.cup = {cup}; accepted: one of the empty containers {', '.join(self.sinks)}")


def load_rehearsal(name: str, overrides: dict | None = None, settings: Sequence[Setting] = ()) -> RehearsalConfig:
    """Load a rehearsal by name (configs/rehearsals) or path; overrides, settings and errors as of `load`."""
    return load(config_path("rehearsals", name, "rehearsal"), RehearsalConfig, overrides, settings)

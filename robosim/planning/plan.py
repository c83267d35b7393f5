"""Planning of a rehearsal's motion, before anything is simulated."""

from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.approach import Approach, plan_approach
from robosim.planning.learned_path import LearnedPath
from robosim.planning.path_clearance import PathClearance, check_dose_reach, check_path
from robosim.planning.picking import add_picking
from robosim.planning.robot_clearance import RobotClearance
from robosim.planning.waypoint_path import WaypointPath
from robosim.robot.assembly import GRIP_TURNS_DEG
from robosim.robot.joint_path import PathSolution, solve_path
from robosim.robot.model import Arm
from robosim.robot.timing import JointMotion, SmoothMotion, compute_time_scale
from robosim.scene.build import assemble_rehearsal, compile_rehearsal

MAX_SLOWDOWNS = 20
"""Times that a motion is slowed down before it is refused."""
LIMIT_SHARE = 0.92
"""Share of the arm's limits to which a motion is slowed down."""
PATH_SAMPLING = 0.01
"""Time [s] between the poses at which the path is solved for joint angles."""
SLOWNESS = 1.3
"""Factor by which a path's derivatives may exceed the limits for it to be tried at full speed: Ruckig's motion through
its knots has a smaller jerk than a spline."""
JOINT_MARGIN = 0.02
"""Distance [rad] from the joints' limits with which a grip is taken without trying others."""


class Plan(NamedTuple):
    """The planned motion of a rehearsal."""

    config: RehearsalConfig
    """With what the planner has chosen: the turn of the tool in the hand, and slower waypoints."""
    path: WaypointPath | LearnedPath
    solution: PathSolution
    motion: JointMotion
    arm: Arm
    clearance: PathClearance
    time_scale: float = 1.0
    """Factor by which a script's waypoints come later than the file says."""
    approach: Approach | None = None
    """The motion from the arm's home to the start of this one; None: `no_approach` says why."""
    no_approach: str = ""


class Grip(NamedTuple):
    """The joint path with the tool held in one way, before its timing."""

    config: RehearsalConfig
    arm: Arm
    path: WaypointPath | LearnedPath
    robot: RobotClearance
    times: np.ndarray
    """(n,) [s]"""
    solution: PathSolution
    clearance: PathClearance
    scales: np.ndarray
    """Factors (n,) on the time about each of `times` that the arm's limits demand at least."""

    @property
    def slowness(self) -> float:
        """Largest factor on time that the arm's limits demand."""
        return float(self.scales.max())


def plan_motion(config: RehearsalConfig) -> Plan:
    """Plan the motion of a rehearsal, and the one from the arm's home to its start.

    Errors as of `plan_path`; a missing way from home is no error.
    """
    plan = plan_path(config)
    if config.tool_fill_height is not None and config.pick is None:
        return plan._replace(no_approach="the tool is full at the start: it is filled where the motion begins")
    try:
        return plan._replace(approach=plan_approach(plan.config, plan.arm, plan.motion.state(0.0).q))
    except ConfigError as error:
        return plan._replace(no_approach=str(error))


def plan_path(config: RehearsalConfig) -> Plan:
    """Plan the motion along a rehearsal's path.

    Tool path, joint path, and joint motion within the arm's limits, without a collision. Where the file leaves it open
    how the hand holds the handle, the turns of GRIP_TURNS_DEG are tried until one can be followed at full speed, away
    from the joints' limits; where none can, the fastest. Learned motions are slowed down where the arm is too slow for
    them, scripts up to `max_time_scale`. Raises ConfigError or UnreachableWaypoint.
    """
    refused: list[ConfigError | UnreachableWaypoint] = []
    grips: list[Grip] = []
    for turn in GRIP_TURNS_DEG if config.grip_turn_deg is None else (config.grip_turn_deg,):
        try:
            grip = solve_grip(config.model_copy(update={"grip_turn_deg": turn}))
            grips.append(grip)
            if grip.slowness <= SLOWNESS and grip.solution.margin >= JOINT_MARGIN:
                return time_motion(grip, 1.0)
        except (ConfigError, UnreachableWaypoint) as error:
            refused.append(error)
    for grip in sorted(grips, key=lambda grip: (max(grip.slowness, 1.0), -grip.solution.margin)):
        try:
            return time_motion(grip, config.max_time_scale)
        except (ConfigError, UnreachableWaypoint) as error:
            refused.append(error)
    raise refused[-1] if grips else refused[0]


def solve_grip(config: RehearsalConfig) -> Grip:
    """Solve the joint path with the tool held as the configuration says; errors as of `plan_motion`."""
    arm = Arm(assemble_rehearsal(config))
    config = add_picking(config, arm.assembly)
    path = LearnedPath(config) if config.trajectory == "learned" else WaypointPath(config)
    return follow_path(config, arm, path, RobotClearance(compile_rehearsal(config), arm))


def follow_path(config: RehearsalConfig, arm: Arm, path: WaypointPath | LearnedPath, robot: RobotClearance) -> Grip:
    """Solve a path for joint angles, and check its clearances; errors as of `plan_motion`."""
    times, solution = solve_joints(arm, path, robot)
    clearance = check_path(config, path, times, solution.q, robot)
    check_dose_reach(config, arm, find_dose_posture(config, path, times, solution), robot)
    return Grip(config, arm, path, robot, times, solution, clearance,
                compute_time_scale(times, solution.q, arm.limits(config.limits)))


def time_motion(grip: Grip, most: float) -> Plan:
    """Put the joint path into time, a script slower by up to a factor where limits demand it; raises ConfigError."""
    limits, scale, reason = grip.arm.limits(grip.config.limits), 1.0, ConfigError("")
    for _ in range(MAX_SLOWDOWNS):
        config, path = grip.config, grip.path
        try:
            motion = SmoothMotion(grip.times, grip.solution.q, limits, path.times, grip.arm.joints)
            return Plan(config, path, grip.solution, motion, grip.arm, grip.clearance, scale)
        except ConfigError as error:
            reason = error
        if isinstance(path, LearnedPath):
            path.slow_down(grip.times, grip.scales / LIMIT_SHARE)
        else:
            factor = max(1.02, grip.slowness / LIMIT_SHARE)
            scale *= factor
            if scale > most:
                raise ConfigError(f"{reason}, or allow the whole motion to be played slower (max_time_scale = "
                                  f"{config.max_time_scale:g}, needed: {scale:.3g})")
            config = slow_down(config, factor)
            path = WaypointPath(config)
        grip = follow_path(config, grip.arm, path, grip.robot)
    slower = grip.path.time_scale if isinstance(grip.path, LearnedPath) else scale
    raise ConfigError(f"the motion is too fast for the arm even {slower:.1f} times slower: {reason}")


def slow_down(config: RehearsalConfig, factor: float) -> RehearsalConfig:
    """Return a configuration whose path takes `factor` times as long; rests at waypoints do not."""
    path = config.path.model_copy(update={"acceleration": config.path.acceleration / factor**2,
                                          "angular_acceleration": config.path.angular_acceleration / factor**2})
    waypoints = tuple(waypoint.model_copy(update={
        "speed": waypoint.speed / factor, "angular_speed": waypoint.angular_speed / factor,
        "acceleration": None if waypoint.acceleration is None else waypoint.acceleration / factor**2,
    }) for waypoint in config.waypoints)
    return config.model_copy(update={"path": path, "waypoints": waypoints})


def find_dose_posture(config: RehearsalConfig, path: WaypointPath | LearnedPath, times: np.ndarray,
                      solution: PathSolution) -> np.ndarray:
    """Return the posture (n,) [rad] at the end of the rest in which the dose begins; the first where none does."""
    return solution.q[int(np.searchsorted(times, path.rests[config.dose_at][1]))] if config.dose else solution.q[0]


def solve_joints(arm: Arm, path: WaypointPath | LearnedPath,
                 robot: RobotClearance) -> tuple[np.ndarray, PathSolution]:
    """Solve a path for joint angles.

    Returns the sampling times [s] (n,) and the solution at them.
    """
    times = np.linspace(0.0, path.duration, int(np.ceil(path.duration / PATH_SAMPLING)) + 1)
    waypoints = [(min(int(np.searchsorted(times, t)), len(times) - 1), name) for name, t in path.times.items()]
    return times, solve_path(arm, [path.pose(t) for t in times], waypoints, times[1] - times[0],
                             clearance=lambda q: robot.least(q).distance)

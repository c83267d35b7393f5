"""A rehearsal's file: the scene and motion of `robosim.config.rehearsal`, and the robot that performs it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import pydantic
from pydantic import Field

from robosim.config import rehearsal
from robosim.config.arm import ArmConfig, ArmServo, BasePose, GripperConfig, PerJoint
from robosim.config.bounds import MAX_ENTRIES, Angle, FilePath, HalfSize, Name, Share
from robosim.config.resources import config_path
from robosim.config.settings import Setting
from robosim.config.table import Table, Vector3, read, validate

APPROACH = "approach"
"""Name of the waypoint from which a hand approaches a tool that it picks up."""
PATH_KEYS = ("material", "motions", "robot", "gripper", "model", "mesh", "workcell")
"""Keys whose values may be paths."""
SUFFIXES = (".yaml", ".yml", ".xml", ".mjcf", ".urdf", ".stl", ".obj")
"""Ends of values that are paths, not names."""


class MotionLimitsConfig(Table):
    """Joint limits of the time-scaled motion."""

    velocity_fraction: Share
    """Largest joint speed as a fraction of the robot's limit."""
    acceleration: PerJoint | None = None
    """Largest acceleration of each joint [rad/s^2]; null: the robot's."""
    jerk: PerJoint | None = None
    """Largest jerk of each joint [rad/s^3]; null: the robot's."""


class ObstacleConfig(Table):
    """A box, or an upright cylinder, that stands in the way."""

    name: Name
    """Its name in errors and reports."""
    position: Vector3
    """Centre [m]."""
    half: tuple[HalfSize, HalfSize, HalfSize]
    """Half sizes [m]; of a cylinder the first is the radius."""
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    """About x, then y, then z of the world."""
    round: bool = False
    """Whether it is a cylinder along its z axis."""


class PickConfig(Table):
    """The tool stands at the first waypoint, and the hand picks it up there."""

    approach: Annotated[float, Field(gt=0.0, le=1.0)] = 0.12
    """Distance [m] from which the open hand comes, along its approach direction."""


class RehearsalConfig(rehearsal.RehearsalConfig):
    """A whole-arm rehearsal. Paths in the file are relative to it."""

    robot: FilePath | ArmConfig = "iiwa14"
    """Name of an arm of models/robots, the path of a .yaml file of one's own, or a table with its keys."""
    gripper: FilePath | GripperConfig | None = None
    """Name of a hand of models/grippers, the path of a .yaml file, a table, or none: the tool is bolted to the flange;
    null: the robot's usual hand."""
    base: BasePose | None = None
    """Where the arm's base stands; null: where the robot's file says."""
    grip_turn_deg: Angle | None = None
    """Turn of the tool in the hand about its handle [deg]; null: the planner chooses, 0 where that can be followed."""
    max_time_scale: Annotated[float, Field(ge=1.0, le=10.0)] = 1.0
    """Largest factor by which the whole motion is played slower where the arm is too slow for the waypoints' speeds; 1:
    refuse such a motion."""
    pick: PickConfig | None = None
    """Whether the tool is picked up; null: the hand holds it from the start."""
    workcell: FilePath | None = None
    """MJCF file of table, floor, lights and cameras, in place of the bundled ones; planning and contacts respect its
    colliding geoms. The grains lie on the plane z = 0 all the same."""
    obstacles: Annotated[tuple[ObstacleConfig, ...], Field(max_length=MAX_ENTRIES)] = ()
    """What stands in the robot's way; grains pass through it."""
    limits: MotionLimitsConfig  # pyright: ignore[reportIncompatibleVariableOverride]
    servo: ArmServo | None = None  # pyright: ignore[reportIncompatibleVariableOverride]
    """Gains of the joints; null: the robot's."""

    @pydantic.model_validator(mode="after")
    def _check_pick(self) -> "RehearsalConfig":
        if self.pick is not None and (self.grasp != "friction" or self.trajectory != "script"):
            raise ValueError(f"pick with grasp: {self.grasp}, trajectory: {self.trajectory}; accepted: friction, "
                             f"script")
        if self.pick is not None and self.gripper == "none":
            raise ValueError("pick with gripper: none; accepted: a gripper")
        return self


def load_rehearsal(name: str, overrides: dict | None = None, settings: Sequence[Setting] = ()) -> RehearsalConfig:
    """Load a rehearsal by name (configs/rehearsals) or path; overrides and settings as of `load`.

    Paths in settings and overrides are relative to the working directory.
    """
    path = config_path("rehearsals", name, "rehearsal")
    table = locate_paths(read(path), path.parent)
    return validate(table, path, RehearsalConfig, overrides, settings)


def locate_paths(value: Any, place: Path) -> Any:
    """Return a file's content with the paths in it made absolute; place: folder that they are relative to."""
    if isinstance(value, dict):
        return {key: str((place / item).resolve()) if _is_path(key, item) else locate_paths(item, place)
                for key, item in value.items()}
    return [locate_paths(item, place) for item in value] if isinstance(value, list) else value


def _is_path(key: Any, value: Any) -> bool:
    return key in PATH_KEYS and isinstance(value, str) and (value.lower().endswith(SUFFIXES) or key == "motions")

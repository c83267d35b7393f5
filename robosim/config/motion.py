"""Configuration of a motion: waypoints of the tool, the rounding between them, joint limits, and names for export."""

from typing import Annotated

import pydantic
from pydantic import Field

from robosim.config.arm import PerJoint
from robosim.config.bounds import (
    MAX_ENTRIES,
    Acceleration,
    Angle,
    AngularAcceleration,
    AngularSpeed,
    Duration,
    Name,
    Share,
    Speed,
    Tolerance,
)
from robosim.config.table import Table, Vector3

APPROACH = "approach"
"""Name of the waypoint from which a hand approaches a tool that it picks up."""
RETREAT = "retreat"
"""Name of the waypoint to which it goes back from a tool that it has set down."""


class PathConfig(Table):
    """How the tool rounds the corners between waypoints."""

    acceleration: Acceleration = 2.0
    """Acceleration of the tool along the path [m/s^2]."""
    angular_acceleration: AngularAcceleration = 10.0
    """Angular acceleration of the tool along the path [rad/s^2]."""
    corner_tolerance: Tolerance = 1.5e-3
    """Largest distance [m] between the rounded path and the screw motions inside a container."""


class WaypointConfig(Table):
    """A pose of the tool, reached by a screw motion from the waypoint before."""

    name: Name
    """Its name in reports and errors."""
    frame: Name
    """Frame of position and rotation: "world", or the name of a container."""
    position: Vector3
    """Position of the tool's frame [m]."""
    rotation_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """Rotations about the frame's x, then y, then z axis [deg]."""
    speed: Speed
    """Speed of the tool on the way to this waypoint [m/s]."""
    angular_speed: AngularSpeed = 1.5
    """Angular speed on the way to this waypoint [rad/s]; the slower of the two decides."""
    stop: bool = False
    """Whether the tool stops there."""
    dwell: Duration = 0.0
    """Duration [s] of the stop."""
    acceleration: Acceleration | None = None
    """Acceleration [m/s^2] in the rounded corner, or before and after the stop; null: path.acceleration."""


class PickConfig(Table):
    """The tool stands at the first waypoint, and the hand picks it up there."""

    approach: Annotated[float, Field(gt=0.0, le=1.0)] = 0.12
    """Distance [m] from which the open hand comes, along its approach direction."""
    set_down: bool = False
    """Whether the hand opens at the last waypoint, where the tool then stands, and goes back by that distance."""


class MotionLimitsConfig(Table):
    """Joint limits of the time-scaled motion."""

    velocity_fraction: Share = 0.9
    """Largest joint speed as a fraction of the robot's limit."""
    acceleration: PerJoint | None = None
    """Largest acceleration of each joint [rad/s^2]; null: the robot's."""
    jerk: PerJoint | None = None
    """Largest jerk of each joint [rad/s^3]; null: the robot's."""


class JointTrajectoryConfig(Table):
    """Names in joint_trajectory.yaml, for the controller that is to play it."""

    frame_id: Name = ""
    """`header.frame_id` of the message."""
    joint_prefix: Name = ""
    """Put before each joint's name: lbr_ gives lbr_A1 to lbr_A7."""
    joint_names: Annotated[dict[Name, Name], Field(max_length=MAX_ENTRIES)] = {}  # noqa: RUF012
    """Names by the model's joint names, instead of a prefix; a joint that is left out keeps its name."""

    @pydantic.model_validator(mode="after")
    def _check_names(self) -> "JointTrajectoryConfig":
        if self.joint_prefix and self.joint_names:
            raise ValueError(f"joint_prefix = {self.joint_prefix!r} with joint_names; accepted: one of the two")
        return self

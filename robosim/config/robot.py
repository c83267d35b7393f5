"""Configuration of the robot: joint limits, servo, gripper."""

from collections.abc import Sequence
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from robosim.config.bounds import MAX_ENTRIES, GraspTime, Name, Share, Text
from robosim.config.resources import config_path
from robosim.config.settings import Setting
from robosim.config.table import Table, Vector7, load

Grip = Literal["weld", "friction"]


class LimitsConfig(Table):
    """Joint limits of the time-scaled motion."""

    velocity_fraction: Share
    """Largest joint speed as a fraction of the data sheet's."""
    acceleration: Vector7
    """Largest acceleration of each joint [rad/s^2]."""
    jerk: Vector7
    """Largest jerk of each joint [rad/s^3]."""


class ServoConfig(Table):
    """Impedance servo of the joints."""

    stiffness: Vector7
    """Stiffness of each joint [N m/rad]."""
    damping: Vector7
    """Damping of each joint [N m s/rad]."""


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


class RobotConfig(Table):
    """Limits and controller of the arm, for a tool that is commanded step by step."""

    description: Text
    """What it is."""
    limits: LimitsConfig
    servo: ServoConfig
    grasp_time: GraspTime
    """Time [s] for the fingers to close before an episode."""


def load_robot(name: str, settings: Sequence[Setting] = ()) -> RobotConfig:
    """Load a robot by name (configs/robots) or path."""
    return load(config_path("robots", name, "robot"), RobotConfig, settings=settings)

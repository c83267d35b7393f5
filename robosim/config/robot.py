"""Configuration of the robot: joint limits, servo, gripper."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field, PositiveFloat

from robosim.config.resources import config_path
from robosim.config.settings import Setting
from robosim.config.table import Table, Vector7, load

Grip = Literal["weld", "friction"]


class LimitsConfig(Table):
    """Joint limits of the time-scaled motion."""

    velocity_fraction: float = Field(gt=0.0, le=1.0)
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


class RobotConfig(Table):
    """Limits and controller of the arm, for a tool that is commanded step by step."""

    description: str
    """What it is."""
    limits: LimitsConfig
    servo: ServoConfig
    grasp_time: PositiveFloat
    """Time [s] for the fingers to close before an episode."""


def load_robot(name: str, settings: Sequence[Setting] = ()) -> RobotConfig:
    """Load a robot by name (configs/robots) or path."""
    return load(config_path("robots", name, "robot"), RobotConfig, settings=settings)

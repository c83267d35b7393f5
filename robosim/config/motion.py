"""Configuration of a motion: joint limits, names for export, and a dose."""

from typing import Annotated, Literal

from pydantic import Field

from robosim.config.arm import StepwiseLimits
from robosim.config.bounds import LARGEST_DOSE, LEAST_DOSE, MAX_ENTRIES, Axis, FilePath, Name, RangeEnd, Share
from robosim.config.table import Table, Vector3


class MotionLimitsConfig(StepwiseLimits):
    """Joint limits of the time-scaled motion."""

    velocity_fraction: Share = 0.9
    """Largest joint speed as a fraction of the robot's limit."""


class JointTrajectoryConfig(Table):
    """Names in joint_trajectory.yaml, for the controller that is to play it."""

    frame_id: Name = ""
    """`header.frame_id` of the message."""
    joint_prefix: Name = ""
    """Put before each joint's name: lbr_ gives lbr_A1 to lbr_A7."""
    joint_names: Annotated[dict[Name, Name], Field(max_length=MAX_ENTRIES)] = {}  # noqa: RUF012
    """Names by the model's joint names, instead of a prefix; a joint that is left out keeps its name."""

    def check(self) -> None:
        if self.joint_prefix and self.joint_names:
            raise ValueError(f"joint_prefix = {self.joint_prefix!r} with joint_names; accepted: one of the two")


class BalanceConfig(Table):
    """The balance under a cup, of which a controller reads what it shows."""

    lag: Annotated[float, Field(ge=0.0, le=10.0)] = 0.2
    """Time constant of its filter [s]."""
    readability: Annotated[float, Field(ge=0.0, le=1.0)] = 1e-5
    """Step of its display [kg]."""
    repeatability: Annotated[float, Field(ge=0.0, le=1.0)] = 1e-5
    """Standard deviation of a reading, before rounding [kg]."""


class DoseConfig(Table):
    """A dose: a controller tilts and shakes the tool about its lip until the balance under the cup shows the target."""

    at: Name | Annotated[int, Field(ge=1, le=MAX_ENTRIES)]
    """Waypoint at which it begins, by name or place in the list (from 0): the tool rests there, level, with its lip
    near the middle of the cup."""
    target_g: Annotated[float, Field(ge=LEAST_DOSE, le=LARGEST_DOSE)]
    """Mass that is wanted [g]."""
    cup: Name | None = None
    """Container that takes the dose and stands on the balance; null: the only empty one."""
    controller: Literal["open_loop", "pi", "shaker"] = "pi"
    """Controller of configs/dosing."""
    controllers: FilePath
    """Name of a file of configs/dosing, or the path of a .yaml file: the controllers' numbers and the pour curve."""
    numbers: Annotated[dict[Name, dict[Name, RangeEnd]], Field(max_length=MAX_ENTRIES)] = {}  # noqa: RUF012
    """Sections of that file with keys that have other values, such as pi: {search_deg: 3}."""
    control_dt: Annotated[float, Field(ge=1e-3, le=0.5)] = 0.02
    """Time between two readings of the balance, and two commands [s]."""
    largest_tilt_deg: Annotated[float, Field(gt=0.0, le=180.0)] = 120.0
    """Tilt [deg] up to which the arm must be able to follow, and beyond which no command goes."""
    vibration_axis: Axis = "x"
    """Axis of the tool's frame along which it vibrates; x of the bundled tools points to the tip."""
    time_limit: Annotated[float, Field(ge=1.0, le=600.0)] = 60.0
    """Time [s] after which the tool is tilted back whatever the controller commands."""
    settle: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    """Time [s] at rest after it, in which the balance settles."""
    lip: Vector3 | None = None
    """Place in the tool's frame [m] where the material leaves it; null: the tool's own lip."""
    balance: BalanceConfig = BalanceConfig()
    """Of the balance under the cup."""

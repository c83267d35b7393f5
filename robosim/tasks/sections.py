"""Sections of a task file: grains, start, actions, success, script and dose."""

from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import Field
from scipy.spatial.transform import Rotation

import mpm
from robosim.config.bounds import (
    LARGEST_DOSE,
    LEAST_DOSE,
    Angle,
    AngularSpeed,
    Axis,
    Count,
    Duration,
    FilePath,
    HalfSize,
    RangeEnd,
    Share,
    Speed,
)
from robosim.config.table import Table, Vector3
from robosim.dosing.command import TOLERANCE_G, TOLERANCE_PERCENT

TARGET_MASS = "target_mass"
"""Name of the mass to dose among the numbers that an episode draws."""
Frequency = Annotated[float, Field(ge=1.0, le=1000.0)]
"""[Hz]"""


class GrainsConfig(Table):
    """Number of grains, and which of them are observed and counted."""

    count: Count
    """Number of grains; N_p in arXiv 2406.09178."""
    observe_every: Count = 1
    """n, if every n-th grain is observed; delta_d in arXiv 2406.09178."""
    elites: Count | None = None
    """Number of grains closest to the goal that the reward counts, for scooping; null: the observed grains count."""

    def check(self) -> None:
        for name, number in (("observe_every", self.observe_every), ("elites", self.elites or 1)):
            if number > self.count:
                raise ValueError(f"{name} = {number}; accepted: up to count = {self.count}")

    @property
    def counted(self) -> int:
        """Grains that the reward counts, N* in the paper."""
        return self.elites or self.count // self.observe_every


class StartConfig(Table):
    """The tool's pose at the start, R = Rz(yaw) Ry(pitch), and random displacements."""

    position: Vector3
    """Origin of the tool's frame in the world [m]."""
    yaw_deg: Angle
    """Rotation about the vertical [deg]."""
    pitch_deg: Angle = 0.0
    """Rotation about the tool's lateral axis [deg]."""
    spread: tuple[HalfSize, HalfSize, HalfSize] = (0.0, 0.0, 0.0)
    """Largest random displacement [m] along each axis; grains in the tool are displaced with it."""
    pile_spread: tuple[HalfSize, HalfSize, HalfSize] = (0.0, 0.0, 0.0)
    """Largest random displacement [m] of the pile along each axis."""

    @property
    def pose(self) -> mpm.Pose:
        """Pose of the tool's frame in the world, without random displacement."""
        rotation = Rotation.from_euler("ZY", (self.yaw_deg, self.pitch_deg), degrees=True)
        return mpm.Pose(np.array(self.position), rotation.as_quat(scalar_first=True))


class VibrationConfig(Table):
    """A vibration that is added to the commanded pose of the tool: a sine along one axis of the tool's frame.

    Action 7 (of six motions, the next one) sets its amplitude from -1, none, to 1; action 8 its frequency."""

    amplitude: Annotated[float, Field(gt=0.0, le=5e-3)]
    """Amplitude [m] of an action of 1."""
    frequency: tuple[Frequency, Frequency]
    """Frequencies [Hz] of an action of -1 and of 1."""
    axis: Axis = "x"
    """Axis of the tool's frame along which it vibrates; x of the bundled tools points to the tip."""

    def check(self) -> None:
        if self.frequency[0] > self.frequency[1]:
            raise ValueError(f"frequency = {self.frequency} Hz; accepted: the lowest and then the highest")


class ActionConfig(Table):
    """Velocities of an action of 1, and the box in which the tool can move."""

    dimensions: Literal[3, 6]
    """3: linear velocity; 6: linear and angular velocity; in world axes."""
    speed: Speed
    """Linear velocity of an action of 1 [m/s]."""
    angular_speed: AngularSpeed = 1.0
    """Angular velocity of an action of 1 [rad/s]."""
    lower: Vector3
    """Lower corner [m] of the box in which the origin of the tool's frame stays."""
    upper: Vector3
    """Upper corner of that box [m]."""
    vibration: VibrationConfig | None = None
    """Vibration of the tool, as two more numbers of an action; null: none."""

    @property
    def size(self) -> int:
        """Numbers of an action."""
        return self.dimensions + (0 if self.vibration is None else 2)

    @pydantic.model_serializer(mode="wrap")
    def _serialize(self, standard: pydantic.SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out that nothing vibrates: what has been learned on a task stays of use."""
        values = standard(self)
        return {name: value for name, value in values.items() if name != "vibration" or value}


class SuccessConfig(Table):
    """What counts as success at the end of an episode."""

    delivered: Share
    """Smallest fraction of the counted grains on the target."""
    turn_error_deg: float | None = Field(None, gt=0.0, le=180.0)
    """Largest error of the tool's rotation [deg]; null: any."""


class ScriptConfig(Table):
    """A waypoint of the scripted policy."""

    time: Duration
    """When it is reached [s]."""
    position: Vector3
    """Origin of the tool's frame in the world [m]."""
    pitch_deg: Angle = 0.0
    """Rotation about the tool's lateral axis [deg]."""


class DosingConfig(Table):
    """A mass to dose: what lies in the receiver, or without one what the tool holds."""

    target_g: tuple[RangeEnd, RangeEnd]
    """Lowest and highest target mass [g], within 1 to 60; each episode draws one between them, all equally likely."""
    tolerance_percent: Annotated[float, Field(ge=0.0, le=100.0)] = TOLERANCE_PERCENT
    """Error [%] of the target up to which a dose is a success."""
    tolerance_g: Annotated[float, Field(ge=0.0, le=LARGEST_DOSE)] = TOLERANCE_G
    """Error [g] up to which it is a success, too."""
    level_pitch_deg: Angle | None = None
    """Pitch [deg] at which the tool is level; null: that of the start."""
    controllers: FilePath | None = None
    """Name of the controllers' numbers in configs/dosing, or the path of a .yaml file; null: none."""

    def check(self) -> None:
        low, high = self.target_g
        if not LEAST_DOSE <= low <= high <= LARGEST_DOSE:
            raise ValueError(f"target_g = {self.target_g} g; accepted: the lowest and then the highest mass, within "
                             f"{LEAST_DOSE:g} to {LARGEST_DOSE:g} g")

"""Sections of a task file: grains, start, actions, reward, success and script."""

from typing import Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt
from scipy.spatial.transform import Rotation

import mpm
from robosim.config.scene import RegionConfig
from robosim.config.table import Table, Vector3


class GrainsConfig(Table):
    """Number of grains, and which of them are observed and counted."""

    count: PositiveInt
    """Grains in the scene, N_p in the paper."""
    observe_every: PositiveInt = 1
    """The observation holds every `observe_every`-th grain, delta_d in the paper."""
    elites: PositiveInt | None = None
    """Grains closest to the goal that the reward of scooping counts; null: the observed ones count."""

    @property
    def counted(self) -> int:
        """Grains that the reward counts, N* in the paper."""
        return self.elites or self.count // self.observe_every


class StartConfig(Table):
    """The tool's pose at the start, R = Rz(yaw) Ry(pitch), and a pile of grains."""

    position: Vector3
    """Origin of the tool's frame in the world [m]."""
    yaw_deg: float
    """Rotation about the vertical [deg]."""
    pitch_deg: float = 0.0
    """Rotation about the tool's lateral axis [deg]."""
    spread: Vector3 = (0.0, 0.0, 0.0)
    """Largest random displacement [m] along each axis; grains in the tool are displaced with it."""
    pile: RegionConfig | None = None
    """Region that the grains fill if neither the tool nor a container holds them."""
    pile_spread: Vector3 = (0.0, 0.0, 0.0)
    """Largest random displacement [m] of that pile along each axis."""

    @property
    def pose(self) -> mpm.Pose:
        """Pose of the tool's frame in the world, without random displacement."""
        rotation = Rotation.from_euler("ZY", (self.yaw_deg, self.pitch_deg), degrees=True)
        return mpm.Pose(np.array(self.position), rotation.as_quat(scalar_first=True))


class ActionConfig(Table):
    """Velocities that an action of 1 stands for, and where the tool may go."""

    dimensions: Literal[3, 6]
    """3: translation; 6: translation and rotation; in world axes."""
    speed: PositiveFloat
    """Linear velocity of an action of 1 [m/s]."""
    angular_speed: PositiveFloat = 1.0
    """Angular velocity of an action of 1 [rad/s]."""
    lower: Vector3
    """Lower corner of the box that the origin of the tool's frame stays in [m]."""
    upper: Vector3
    """Upper corner of that box [m]."""


class DistanceConfig(Table):
    """Distance term of the reward.

    Each step earns beta (gamma - sum of weighted Manhattan distances), with gamma = N* reference and
    beta = total / (steps gamma). An episode in which nothing moves earns total (1 - start distance / reference).
    """

    weights: Vector3
    """Weights of the distances along x, y and z."""
    total: PositiveFloat
    """Reward of an episode spent on the goal."""
    reference: PositiveFloat
    """Weighted distance [m] at which nothing is earned."""


class TurnConfig(Table):
    """Rotation term of the reward: scale (margin - |rotation - angle|), in rad, about the tool's lateral axis."""

    scale: PositiveFloat
    """Reward per rad."""
    margin: PositiveFloat
    """Error [rad] at which nothing is earned."""
    angle_deg: float
    """Rotation from the start's orientation that the task asks for [deg]."""


class RewardConfig(Table):
    """Weights of the paper's reward terms, per grain and per step of `step_dt`."""

    distance: DistanceConfig
    """Distance of the counted grains to the goal, every step."""
    target: PositiveFloat
    """Per grain, + on the target, - off it; beta^t in the paper."""
    poured: float = Field(0.0, ge=0.0)
    """Per grain in the last step, + poured out, - not; beta^p in the paper."""
    lost: float = Field(0.0, le=0.0)
    """Per grain that leaves the bounds; beta^n in the paper."""
    contact: float = Field(0.0, ge=0.0)
    """Per grain that touches the tool, every step; beta^c in the paper."""
    collision: float = Field(0.0, le=0.0)
    """Per step in which the tool hits the container; beta^i in the paper."""
    turn: TurnConfig | None = None
    """Rotation of the tool, in the last step."""


class SuccessConfig(Table):
    """What counts as success at the end of an episode."""

    delivered: float = Field(gt=0.0, le=1.0)
    """Least share of the counted grains on the target."""
    turn_error_deg: PositiveFloat | None = None
    """Largest error of the tool's rotation [deg]; null: any."""


class ScriptConfig(Table):
    """A waypoint of the scripted policy."""

    time: float = Field(ge=0.0)
    """When it is reached [s]."""
    position: Vector3
    """Origin of the tool's frame in the world [m]."""
    pitch_deg: float = 0.0
    """Rotation about the tool's lateral axis [deg]."""

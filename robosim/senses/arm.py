"""Terms of the arm's own sensors: joints, joint torques and the wrist's force and torque."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from robosim.senses.term import NOTHING, SenseScene, Sight, Term, box

TORQUE_RANGE = 3.0
"""Largest torque that a joint's sensor shows, in the joint's limits: beyond its motor's, contact adds to it."""
FORCE_RANGE, MOMENT_RANGE = 500.0, 50.0
"""Range of the wrist sensor [N], [N m]: assumed, as wide as that of sensors for arms of this size."""


class ArmTerm(Term):
    """A term that needs the arm."""

    reads_sensors = True

    @classmethod
    def missing(cls, scene: SenseScene) -> str:
        return "" if scene.arm is not None else "arm = True"


class JointsTerm(ArmTerm):
    """Joint angles and speeds."""

    name, unit = "joints", "rad, rad/s"

    def __init__(self, scene: SenseScene) -> None:
        arm = scene.arm.cell.arm
        margin = 0.05 * (arm.upper - arm.lower)
        self.space = box(np.concatenate([arm.lower - margin, -2.0 * arm.velocity]),
                         np.concatenate([arm.upper + margin, 2.0 * arm.velocity]))

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return q and qd (2 n,)."""
        return np.concatenate([sight.sensors.cell.q, sight.sensors.cell.qd])


class TorquesTerm(ArmTerm):
    """Readings of the joint torque sensors, and the external torques that the controller estimates from them."""

    name, unit = "torques", "N m"

    def __init__(self, scene: SenseScene) -> None:
        limits = np.tile(TORQUE_RANGE * scene.arm.cell.arm.torque_limits, 2)
        self.space = box(-limits, limits)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the sensed and the external torques (2 n,), means over the action."""
        return np.concatenate([sight.sensors.torque, sight.sensors.external])


class WristTerm(Term):
    """Force and torque at the wrist, the mean over the action.

    With the arm: of the sensor between flange and hand, in its axes, with the weight of hand and tool. Without: the
    force and torque that hold the tool against its grains, in the tool's axes. tare: whether the value at the start of
    the episode is subtracted."""

    name, unit = "wrist", "N, N m"
    reads_sensors = True

    def __init__(self, scene: SenseScene, tare: bool = False) -> None:
        self._tare = bool(tare)
        limits = np.repeat([FORCE_RANGE, MOMENT_RANGE], 3)
        self.space = box(-limits, limits)

    def begin(self, sight: Sight, drawn: Mapping[str, float] = NOTHING) -> Any:
        """Return the offset (6,) that is subtracted from now on."""
        return self._wrench(sight) if self._tare else np.zeros(6)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        return self._wrench(sight) - memory

    @staticmethod
    def _wrench(sight: Sight) -> np.ndarray:
        if sight.sensors is not None:
            return np.asarray(sight.sensors.wrist)
        R, (force, moment) = sight.pose.matrix, np.split(sight.received / (sight.duration or 1.0), [3])
        return -np.concatenate([R.T @ force, R.T @ (moment - np.cross(sight.pose.position, force))])

"""Torque control of the arm: impedance about the commanded motion, feed-forward, data-sheet clipping."""

import numpy as np

from robosim.arm import Arm
from robosim.config import ServoConfig
from robosim.smoothing import JointState


class Servo:
    """Joint impedance servo. `saturated` counts commands that the torque limits clipped."""

    def __init__(self, arm: Arm, config: ServoConfig) -> None:
        self.arm = arm
        self._stiffness, self._damping = np.array(config.stiffness), np.array(config.damping)
        self.saturated = 0
        self.demand = np.zeros(7)
        """Torques [N m] of the last command before clipping."""

    def torque(self, wanted: JointState, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Motor torques [N m] (7,) at angles q [rad] and speeds qd [rad/s]: K (q* - q) + D (q*' - q') + model."""
        tau = self._stiffness * (wanted.q - q) + self._damping * (wanted.qd - qd)
        tau += self.arm.inverse_dynamics(q, wanted.qd, wanted.qdd)
        self.demand = tau
        clipped = np.clip(tau, -self.arm.torque_limits, self.arm.torque_limits)
        self.saturated += int(np.any(clipped != tau))
        return clipped

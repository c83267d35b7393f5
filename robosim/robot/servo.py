"""Torque control of the arm: impedance about the commanded motion, feed-forward, data-sheet clipping."""

import mujoco
import numpy as np

from robosim.config.robot import ServoConfig
from robosim.errors import ConfigError
from robosim.robot.model import Arm
from robosim.robot.timing import JointState


class Servo:
    """Joint impedance servo. `saturated` counts commands that the torque limits clipped."""

    def __init__(self, arm: Arm, config: ServoConfig) -> None:
        self.arm = arm
        self._stiffness, self._damping = np.array(config.stiffness), np.array(config.damping)
        self.saturated = 0
        self.demand = np.zeros(7)
        """Torques [N m] of the last command before clipping."""

    def check(self, model: mujoco.MjModel, data: mujoco.MjData, dofs: np.ndarray) -> None:
        """Raise ConfigError where MuJoCo's step is too long for the gains, with the arm's inertia as it is in data: a
        torque that is held for a step dt feeds energy in from 2 dt d + dt^2 k = 4 on, d and k the largest damping and
        stiffness per inertia."""
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        answer = np.linalg.inv(M)[np.ix_(dofs, dofs)]
        d, k = (float(np.linalg.eigvals(answer * gains).real.max()) for gains in (self._damping, self._stiffness))
        bound = (np.sqrt(d * d + 4.0 * k) - d) / k
        if model.opt.timestep >= bound:
            raise ConfigError(f"host_dt = {model.opt.timestep:g} s: the servo's stiffness and damping need steps below "
                              f"{bound:.3g} s; take a shorter step or softer gains")

    def torque(self, wanted: JointState, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Motor torques [N m] (7,) at angles q [rad] and speeds qd [rad/s]: K (q* - q) + D (q*' - q') + model."""
        tau = self._stiffness * (wanted.q - q) + self._damping * (wanted.qd - qd)
        tau += self.arm.inverse_dynamics(q, wanted.qd, wanted.qdd)
        self.demand = tau
        clipped = np.clip(tau, -self.arm.torque_limits, self.arm.torque_limits)
        self.saturated += int(np.any(clipped != tau))
        return clipped

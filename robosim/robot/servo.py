"""Joint impedance control of the arm with feed-forward of the model, clipped at the torque limits."""

import mujoco
import numpy as np

from robosim.config.robot import ServoConfig
from robosim.errors import ConfigError
from robosim.robot.model import Arm
from robosim.robot.timing import JointState


class Servo:
    """Joint impedance servo of an arm."""

    def __init__(self, arm: Arm, config: ServoConfig) -> None:
        self.arm = arm
        self._stiffness, self._damping = np.array(config.stiffness), np.array(config.damping)
        self.saturations = 0
        """Number of commands that the torque limits clipped."""
        self.demanded_torque = np.zeros(7)
        """Torques [N m] (7,) of the last command before clipping."""

    def check_step(self, model: mujoco.MjModel, data: mujoco.MjData, dofs: np.ndarray) -> None:
        """Raise ConfigError where MuJoCo's step is too long for the gains.

        A torque that is constant over a step dt adds energy from 2 dt d + dt^2 k = 4 on, with d and k the largest
        damping and stiffness per inertia. data: scene in the posture that is checked. dofs (7,): indices of the arm.
        """
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        inverse_inertia = np.linalg.inv(M)[np.ix_(dofs, dofs)]
        d, k = (float(np.linalg.eigvals(inverse_inertia * gains).real.max())
                for gains in (self._damping, self._stiffness))
        bound = (np.sqrt(d * d + 4.0 * k) - d) / k
        if model.opt.timestep >= bound:
            raise ConfigError(f"host_dt = {model.opt.timestep:g} s: the servo's stiffness and damping need steps below "
                              f"{bound:.3g} s; choose a shorter step or softer gains")

    def compute_torque(self, target: JointState, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Compute clipped motor torques [N m] (7,).

        tau = K (q* - q) + D (q*' - q') + inverse dynamics. q, qd: measured angles [rad] and speeds [rad/s], each (7,).
        target: commanded joint state q*.
        """
        tau = self._stiffness * (target.q - q) + self._damping * (target.qd - qd)
        tau += self.arm.inverse_dynamics(q, target.qd, target.qdd)
        self.demanded_torque = tau
        clipped = np.clip(tau, -self.arm.torque_limits, self.arm.torque_limits)
        self.saturations += int(np.any(clipped != tau))
        return clipped

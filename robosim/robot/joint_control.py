"""Control of the joints step by step: smoothed commands, an impedance servo, and torque sensors."""

from typing import Any

import mujoco
import numpy as np
from ruckig import ControlInterface, InputParameter, OutputParameter, Result, Ruckig, Synchronization

from robosim.base.errors import ConfigError, RobotDiverged
from robosim.robot.model import Arm, Gains, MotionLimits
from robosim.robot.timing import JointState

CATCH_UP = 20.0
"""Rate [1/s] at which the smoothed motion closes the gap to its goal."""


class JointSmoother:
    """Follows moving joint angles within the limits of speed, acceleration and jerk.

    Ruckig is given target velocities: the goal's, plus what closes the gap to it. With target positions that move
    from step to step it takes long ways around a goal that is near. Every step plans anew: Ruckig would otherwise
    follow its last plan where the request is unchanged, and round otherwise than one that begins in the same state."""

    def __init__(self, limits: MotionLimits, dt: float, arm: Arm) -> None:
        n = len(arm.joints)
        self._otg, self._request, self._output = Ruckig(n, dt), InputParameter(n), OutputParameter(n)
        self._speed = limits.velocity
        self._lower, self._upper = arm.lower, arm.upper
        self._request.control_interface = ControlInterface.Velocity
        self._request.synchronization = Synchronization.No
        self._request.max_velocity = list(self._speed)
        self._request.max_acceleration = list(limits.acceleration)
        self._request.max_jerk = list(limits.jerk)
        self.restart(np.zeros(n))

    def restart(self, q: np.ndarray) -> None:
        """Begin at rest at joint angles q [rad] (n,)."""
        self._q, self._time = np.array(q), 0.0
        self._request.current_position = list(q)
        self._request.current_velocity = self._request.current_acceleration = [0.0] * len(q)

    def state(self) -> dict[str, Any]:
        """Return angles, speeds, accelerations of the smoothed motion, and its time."""
        request = self._request
        return {"motion": np.array([self._q, request.current_velocity, request.current_acceleration]),
                "time": self._time}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        q, qd, qdd = state["motion"]
        self.restart(q)
        self._request.current_velocity, self._request.current_acceleration = list(qd), list(qdd)
        self._time = state["time"]

    def step(self, q: np.ndarray, qd: np.ndarray) -> JointState:
        """Advance a step towards moving angles q [rad] (n,) with speeds qd [rad/s] (n,); raises RobotDiverged."""
        velocity = qd + CATCH_UP * (np.clip(q, self._lower, self._upper) - self._q)
        self._request.target_velocity = list(np.clip(velocity, -self._speed, self._speed))
        self._time += self._otg.delta_time
        self._otg.reset()
        if self._otg.update(self._request, self._output) not in (Result.Working, Result.Finished):
            raise RobotDiverged(self._time, ["the smoother found no motion within the joints' limits"])
        self._output.pass_to_input(self._request)
        self._q = np.array(self._output.new_position)
        return JointState(self._q, np.array(self._output.new_velocity), np.array(self._output.new_acceleration))


class Servo:
    """Joint impedance servo of an arm."""

    def __init__(self, arm: Arm, gains: Gains | None = None) -> None:
        self.arm = arm
        self._gains = self._stiffness, self._damping = arm.gains() if gains is None else gains
        self.saturations = 0
        """Number of commands that the torque limits clipped."""
        self.demanded_torque = np.zeros(len(arm.joints))
        """Torques [N m] (n,) of the last command before clipping."""

    def scale(self, stiffness: float, damping: float) -> None:
        """Set the gains to those of the beginning times two factors."""
        self._stiffness, self._damping = stiffness * self._gains[0], damping * self._gains[1]

    def check_step(self, model: mujoco.MjModel, data: mujoco.MjData, dofs: np.ndarray) -> None:
        """Raise ConfigError where MuJoCo's step is too long for the gains.

        A torque that is constant over a step dt adds energy from 2 dt d + dt^2 k = 4 on, with d and k the largest
        damping and stiffness per inertia. data: scene in the posture that is checked. dofs (n,): indices of the arm."""
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        inverse_inertia = np.linalg.inv(M)[np.ix_(dofs, dofs)]
        # the eigenvalues of M^-1 diag(gains), of a symmetric matrix that is similar to it
        roots = [np.sqrt(gains) for gains in (self._damping, self._stiffness)]
        d, k = (float(np.linalg.eigvalsh(root[:, None] * inverse_inertia * root)[-1]) for root in roots)
        bound = (np.sqrt(d * d + 4.0 * k) - d) / k
        if model.opt.timestep >= bound:
            raise ConfigError(f"host_dt = {model.opt.timestep:g} s: the servo's stiffness and damping need steps below "
                              f"{bound:.3g} s; choose a shorter step or softer gains")

    def compute_torque(self, target: JointState, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Compute clipped motor torques [N m] (n,).

        tau = K (q* - q) + D (q*' - q') + inverse dynamics. q, qd: measured angles [rad] and speeds [rad/s], each (n,).
        target: commanded joint state q*."""
        tau = self._stiffness * (target.q - q) + self._damping * (target.qd - qd)
        tau += self.arm.inverse_dynamics(q, target.qd, target.qdd)
        self.demanded_torque = tau
        clipped = np.clip(tau, -self.arm.torque_limits, self.arm.torque_limits)
        self.saturations += int(np.any(clipped != tau))
        return clipped


class TorqueSensors:
    """Readings of the joint torque sensors of `robot.assembly`."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, arm: Arm) -> None:
        self._data, self._arm = data, arm
        self._axes = np.array([model.joint(name).axis for name in arm.joints])
        self._addresses = np.array([model.sensor(f"{name}_torque").adr[0] for name in arm.joints])

    def read(self) -> np.ndarray:
        """Read the torques [N m] (n,) on the links about their joints' axes. As of the last step's begin."""
        readings = self._data.sensordata[self._addresses[:, None] + np.arange(3)]
        return np.einsum("ij,ij->i", readings, self._axes)

    def estimate_external(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Estimate the external torques [N m] (n,) on the joints.

        The model of arm, hand and empty tool, less the sensors. This is what a robot's controller reports as external
        torque; a load in the tool is external to it."""
        return self._arm.rigid_torque(q, qd, qdd) - self.read()

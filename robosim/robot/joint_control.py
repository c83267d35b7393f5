"""Control of the joints step by step: smoothed commands, a servo, and torque sensors."""

from typing import Any

import mujoco
import numpy as np
from ruckig import ControlInterface, InputParameter, OutputParameter, Result, Ruckig, Synchronization

from robosim.base.errors import ConfigError, RobotDiverged
from robosim.robot.model import Arm, Gains, MotionLimits
from robosim.robot.timing import JointState

OSCILLATION = 0.02
"""Share of a joint's speed limit by which its speed jumps back and forth in every step where the servo is unstable."""
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
        self._speed, self._lower, self._upper = limits.velocity, arm.lower, arm.upper
        self._request.control_interface = ControlInterface.Velocity
        self._request.synchronization = Synchronization.No
        self._request.max_velocity, self._request.max_acceleration, self._request.max_jerk = map(list, limits)
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
    """Joint servo of an arm: impedance control with gains of torque, computed torque with those per inertia.
    dt: MuJoCo's step [s]."""

    def __init__(self, arm: Arm, gains: Gains, dt: float) -> None:
        self.arm, self.gains, self._initial, self._dt = arm, gains, gains, dt
        self.saturations = 0
        """Number of commands that the torque limits clipped."""
        self.demanded_torque = np.zeros(len(arm.joints))
        """Torques [N m] (n,) of the last command before clipping."""

    def scale(self, stiffness: float, damping: float) -> None:
        """Set the gains to those of the beginning times two factors."""
        self.gains = self._initial._replace(stiffness=stiffness * self._initial.stiffness,
                                            damping=damping * self._initial.damping)

    def check_step(self, model: mujoco.MjModel, data: mujoco.MjData, dofs: np.ndarray) -> None:
        """Raise ConfigError where MuJoCo's step is too long for the gains.

        A torque that is constant over a semi-implicit step dt adds energy from 2 dt d + dt^2 k = 4 on, with d and k the
        largest damping and stiffness per inertia. implicitfast adds dt times the joints' passive damping to the
        inertia. data: scene in the posture that is checked, whose fingers and held tool lower the inertia of the arm.
        dofs (n,): indices of the arm."""
        M, passive, inertia = np.zeros((model.nv, model.nv)), model.dof_damping, np.eye(len(dofs))
        mujoco.mj_fullM(model, data, M)
        try:
            mobility = np.linalg.inv(M + self._dt * np.diag(passive))[np.ix_(dofs, dofs)]
        except np.linalg.LinAlgError:
            raise ConfigError(f"inertias of joints up to {M.max():.2g}; accepted: an arm's, in kg and m") from None
        if self.gains.per_inertia:
            inertia = self.arm.inertia(data.qpos[model.jnt_qposadr[model.dof_jntid[dofs]]], self._dt)
        ds, modes = map(np.real, np.linalg.eig(mobility @ (inertia * self.gains.damping + np.diag(passive[dofs]))))
        d, k = ds.max(), np.linalg.eigvals(mobility @ (inertia * self.gains.stiffness)).real.max()
        bound = (np.sqrt(d * d + 4.0 * k) - d) / k
        if self._dt >= bound:
            servo = self.describe(int(np.argmax(np.abs(modes[:, np.argmax(ds)]))))
            raise ConfigError(f"host_dt = {self._dt:g} s: {servo} needs steps below {bound:.3g} s; accepted: "
                              f"a shorter host_dt, or a softer servo")

    def check_motion(self, time: float, qd: np.ndarray) -> None:
        """Raise RobotDiverged where the speeds (k, n) [rad/s] of the last k steps show an unstable joint.
        The unstable mode of a sampled servo changes its sign from step to step. time: that of the last step [s]."""
        jumps = np.diff(qd, axis=0) / self.arm.velocity
        smallest = np.abs(jumps).min(axis=0) * np.all(jumps[1:] * jumps[:-1] < 0.0, axis=0)
        if smallest.max() > OSCILLATION:
            raise RobotDiverged(time, [f"{self.describe(int(np.argmax(smallest)))} is unstable in steps of host_dt = "
                                       f"{self._dt:g} s; accepted: a shorter host_dt, or a softer servo"])

    def describe(self, joint: int) -> str:
        """Return a joint, by its number, with its gains."""
        (stiffness, damping), rate = (gain[joint] for gain in self.gains[:2]), np.sqrt(self.gains.stiffness[joint])
        gains = f"bandwidth {rate / (2.0 * np.pi):.3g} Hz, damping ratio {0.5 * damping / rate:.3g}" \
            if self.gains.per_inertia else f"stiffness {stiffness:.3g}, damping {damping:.3g}"
        return f"the servo of joint {self.arm.joints[joint]} ({gains})"

    def compute_torque(self, target: JointState, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Compute clipped motor torques [N m] (n,).
        tau = K (q* - q) + D (q*' - q') + inverse dynamics; K and D multiply the inertia matrix where they are gains per
        inertia. q, qd: measured angles [rad] and speeds [rad/s], each (n,). target: commanded joint state q*."""
        feedback = self.gains.stiffness * (target.q - q) + self.gains.damping * (target.qd - qd)
        torque, acceleration, dt = (0.0, feedback, self._dt) if self.gains.per_inertia else (feedback, 0.0, 0.0)
        tau = torque + self.arm.inverse_dynamics(q, target.qd, target.qdd + acceleration, dt)
        self.demanded_torque = tau
        limits = self.arm.torque_limits
        clipped = np.minimum(np.maximum(tau, -limits), limits)  # a third of the time of `np.clip`
        self.saturations += int((clipped != tau).any())
        return clipped


class TorqueSensors:
    """Readings of the joint torque sensors of `robot.assembly`."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, arm: Arm) -> None:
        self._data, self._arm = data, arm
        self._axes = np.array([model.joint(name).axis for name in arm.joints])
        self._addresses = np.array([model.sensor(f"{name}_torque").adr[0] for name in arm.joints])

    def read(self, sensordata: np.ndarray | None = None) -> np.ndarray:
        """Read the torques [N m] (..., n) on the links about their joints' axes. As of the last step's begin.
        sensordata: MuJoCo's of many steps (..., values); None: the present one."""
        values = self._data.sensordata if sensordata is None else sensordata
        return np.einsum("...ij,ij->...i", values[..., self._addresses[:, None] + np.arange(3)], self._axes)

    def estimate_external(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray,
                          sensordata: np.ndarray | None = None) -> np.ndarray:
        """Estimate the external torques [N m] (..., n) on the joints, of one step or many, as `read`.
        The model of arm, hand and empty tool, less the sensors. This is what a robot's controller reports as external
        torque; a load in the tool is external to it."""
        modelled = [self._arm.rigid_torque(*state) for state in zip(*map(np.atleast_2d, (q, qd, qdd)))]
        return np.reshape(modelled, np.shape(q)) - self.read(sensordata)

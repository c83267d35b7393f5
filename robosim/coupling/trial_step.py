"""Trial MuJoCo steps with rollback."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

import mpm
from robosim.robot.mjspec import body_pose

LINEAR_FIRST = [3, 4, 5, 0, 1, 2]
"""Columns of a velocity of MuJoCo's, which has the angular one first."""
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""All that a step depends on. A copy of the whole MjData would take longer than a trial."""


@contextmanager
def disable_control_callback() -> Iterator[None]:
    """Switch the user's control callback off during trial steps: it acts once per accepted step."""
    callback = mujoco.get_mjcb_control()
    mujoco.set_mjcb_control(None)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(callback)


class TrialStep:
    """One `mj_step` that can be tried before it is accepted; bodies: MuJoCo indices of the coupled bodies.
    A step is `begin` (positions and velocities), any number of trials, and `finish`. A Runge-Kutta or discrete step
    calls the user's control callback in `finish`, as often as `mj_step` does; its trials use the last controls."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int]) -> None:
        self.model, self.data, self.bodies = model, data, bodies
        self._start = np.empty(mujoco.mj_stateSize(model, STATE))
        kinds, chosen = mujoco.mjtIntegrator, model.opt.integrator
        self.is_whole = chosen in (kinds.mjINT_RK4, kinds.mjINT_DISCRETE)
        """Trials share no part of it: Runge-Kutta evaluates all again, a discrete step has no public end."""
        is_euler = chosen == kinds.mjINT_EULER
        self._integrate = mujoco.mj_Euler if is_euler else mujoco.mj_implicit

    def begin(self) -> None:
        """Evaluate positions and velocities, also where the user changed qpos since, and store the state."""
        if self.is_whole:
            with disable_control_callback():
                mujoco.mj_forward(self.model, self.data)
        else:
            mujoco.mj_step1(self.model, self.data)
        mujoco.mj_getState(self.model, self.data, self._start, STATE)

    def finish(self) -> None:
        """Step under the forces in data; frames and velocities are then those after the step."""
        if self.is_whole:
            mujoco.mj_step(self.model, self.data)
        else:
            mujoco.mj_step2(self.model, self.data)
        self.update_frames()

    def roll_back(self) -> None:
        """Return to the state after `begin`, without another call of the user's control callback."""
        mujoco.mj_setState(self.model, self.data, self._start, STATE)
        for evaluate in (mujoco.mj_fwdPosition, mujoco.mj_sensorPos, mujoco.mj_fwdVelocity, mujoco.mj_sensorVel):
            evaluate(self.model, self.data)

    def integrate_velocities(self) -> None:
        """Compute the velocities after the step under the wrenches in data, after `begin`."""
        if self.is_whole:
            with disable_control_callback():
                mujoco.mj_step(self.model, self.data)
        else:
            mujoco.mj_fwdAcceleration(self.model, self.data)
            mujoco.mj_fwdConstraint(self.model, self.data)
            self._integrate(self.model, self.data)

    def restore(self) -> None:
        """Return to the state after `begin` from trials of `integrate_velocities`, which change frames alone."""
        if self.is_whole:
            self.roll_back()
        else:
            mujoco.mj_setState(self.model, self.data, self._start, STATE)
            self.update_frames()

    def predict_poses(self, wrenches: np.ndarray) -> list[mpm.Pose]:
        """Predict the bodies' world poses after the step under wrenches (nbody, 6) besides the scene's forces."""
        self.data.xfrc_applied += wrenches
        if self.is_whole:
            with disable_control_callback():
                self.finish()
        else:
            self.finish()
        poses = [body_pose(self.data, body) for body in self.bodies]
        self.roll_back()
        return poses

    def update_frames(self) -> None:
        """Update frames and velocities of the bodies from qpos and qvel."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)

    def twists(self) -> np.ndarray:
        """Return the twists (B, 6) of the bodies, linear and angular, in world axes about their centres of mass."""
        result = np.empty((len(self.bodies), 6))
        for row, body in zip(result, self.bodies):
            mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, body, row, 0)
        return result[:, LINEAR_FIRST]

    def jacobian(self) -> np.ndarray:
        """Return the bodies' twists per joint velocity (6 B, nv), rows in the order of `twists`."""
        result = np.empty((len(self.bodies), 2, 3, self.model.nv))
        for (linear, angular), body in zip(result, self.bodies):
            mujoco.mj_jacBodyCom(self.model, self.data, linear, angular, body)
        return result.reshape(-1, self.model.nv)

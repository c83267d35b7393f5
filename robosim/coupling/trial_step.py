"""A MuJoCo step that is tried out before it is taken."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import mujoco
import numpy as np

import mpm
from mpm.geometry.rigid_motion import quaternion_of, relative_rotation
from robosim.errors import RobotDiverged
from robosim.scene.frames import body_pose

PROBE = 0.01
"""Probing impulse, as a share of what the body's weight gives in a step: within one state of sticking contacts."""
PROBE_ARM = 0.05
"""[m] at which the probing impulse pulls when it probes rotation."""
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
RANK = 1e-9
"""Share of the largest answer below which a direction counts as fixed."""
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""All that a step depends on. A copy of the whole MjData would take longer than the probing."""


@contextmanager
def uncontrolled() -> Iterator[None]:
    """Without the user's control callback: what it does and counts belongs to steps that are taken."""
    callback = mujoco.get_mjcb_control()
    mujoco.set_mjcb_control(None)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(callback)


class Foresight(NamedTuple):
    """How the coupled bodies would move over the coming step, all in world axes about their centres of mass."""

    twists: np.ndarray
    """Now (B, 6): linear, angular."""
    free: np.ndarray
    """After the step, if no grain touched (B, 6)."""
    mobility: np.ndarray
    """Change of the twists after the step by impulses on the bodies (6 B, 6 B)."""


class Twin:
    """Tries steps of a MuJoCo scene and takes them back.

    A step is `begin` (positions and velocities), any number of trials, and `finish`; together they are one `mj_step`.
    A Runge-Kutta step calls the user's control callback in `finish`, as often as `mj_step` does, and holds its last
    controls in trials.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int]) -> None:
        self.model, self.data, self.bodies = model, data, bodies
        self._start = np.empty(mujoco.mj_stateSize(model, STATE))
        # views: looking the arrays up anew takes longer than what a probe computes
        self._qpos, self._qvel, self._qacc, self._act = data.qpos, data.qvel, data.qacc, data.act
        self._warm, self._wrenches = data.qacc_warmstart, data.xfrc_applied
        # a Runge-Kutta step evaluates everything anew within it: such a step cannot be shared with its trials
        self._whole = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        euler = model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
        self._integrate = mujoco.mj_Euler if euler else mujoco.mj_implicit

    def begin(self) -> None:
        """Evaluate positions and velocities, fresh even after the user changed qpos, and remember the state."""
        if self._whole:
            with uncontrolled():
                mujoco.mj_forward(self.model, self.data)
        else:
            mujoco.mj_step1(self.model, self.data)
        mujoco.mj_getState(self.model, self.data, self._start, STATE)

    def restart(self) -> None:
        """Back to the state after `begin`; the user's control callback is not called again."""
        mujoco.mj_setState(self.model, self.data, self._start, STATE)
        for evaluate in (mujoco.mj_fwdPosition, mujoco.mj_sensorPos, mujoco.mj_fwdVelocity, mujoco.mj_sensorVel):
            evaluate(self.model, self.data)

    def finish(self) -> None:
        """Step, with the forces that data holds now; frames and velocities are those after the step."""
        if self._whole:
            mujoco.mj_step(self.model, self.data)
        else:
            mujoco.mj_step2(self.model, self.data)
        self._refresh()

    def bring(self, poses: dict[int, mpm.Pose]) -> None:
        """Move bodies (place among the twin's -> pose) the little way to poses, along what impulses on them would move,
        and keep their twists; the other bodies follow as they hang together.

        MuJoCo moves a body over a whole step with the velocity at its end, whenever in the step an impulse came.
        """
        data, offset, rows = self.data, [], [6 * i + k for i in poses for k in range(6)]
        for i, pose in poses.items():
            body, R = self.bodies[i], pose.matrix
            axes = data.xmat[self.bodies[i]].reshape(3, 3)
            centre = axes.T @ (data.xipos[body] - data.xpos[body])  # in the frame
            turn = relative_rotation(UPRIGHT, quaternion_of(R @ axes.T))
            offset += [pose.position + R @ centre - data.xipos[body], turn]
        twists = self.twists()
        impulses = np.linalg.lstsq(self._mobility[rows], np.concatenate(offset), rcond=RANK)[0]
        mujoco.mj_integratePos(self.model, data.qpos, self._joint_answers @ impulses, 1.0)
        self._refresh()
        # the same joint velocities are another twist in the new place
        answers = (self._jacobian() @ self._joint_answers)[rows]
        change = (twists - self.twists()).ravel()[rows]
        data.qvel += self._joint_answers @ np.linalg.lstsq(answers, change, rcond=RANK)[0]
        mujoco.mj_comVel(self.model, data)

    def _refresh(self) -> None:
        """Frames and velocities of the present positions."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)

    def poses_after(self, load: np.ndarray) -> list[mpm.Pose]:
        """Frames of the bodies after the step under wrenches (nbody, 6) besides the scene's own forces."""
        self._wrenches += load
        if self._whole:
            with uncontrolled():
                self.finish()
        else:
            self.finish()
        ends = [body_pose(self.data, body) for body in self.bodies]
        self.restart()
        return ends

    def twists(self) -> np.ndarray:
        """Twists (B, 6) of the bodies about their centres of mass: linear, angular."""
        result, row = np.empty((len(self.bodies), 6)), np.empty(6)
        for i, body in enumerate(self.bodies):
            mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, body, row, 0)
            result[i, :3], result[i, 3:] = row[3:], row[:3]
        return result

    def foresee(self, load: np.ndarray) -> Foresight:
        """Probe the step about the wrenches (nbody, 6) that the grains are expected to put on the bodies.

        The answers hold arm posture, drives, joint friction and grasp as they are now, because it is MuJoCo's own step
        that answers: the scene takes each trial's velocities, and at the end it is back where it began.
        """
        n, h = len(self.bodies), self.model.opt.timestep
        masses = self.model.body_mass[self.bodies]
        now, jacobian = self.twists(), self._jacobian()
        self._wrenches += load
        loaded = self._wrenches.copy()
        begin = self._qpos.copy(), self._qvel.copy(), self._act.copy()
        if not self._whole:
            mujoco.mj_fwdActuation(self.model, self.data)
        self._integrate_trial()
        base, place, warm = self._qvel.copy(), self._qpos.copy(), self._qacc.copy()
        answers = np.empty((6 * n, self.model.nv))
        for i, body in enumerate(self.bodies):
            unit = PROBE * h * max(masses[i], 1e-6) * 9.81
            for k in range(6):
                size = unit if k < 3 else unit * PROBE_ARM
                self._qpos[:], self._qvel[:], self._act[:] = begin
                self._warm[:] = warm
                self._wrenches[:] = loaded
                self._wrenches[body, k] += size / h
                self._integrate_trial()
                np.subtract(self._qvel, base, out=answers[6 * i + k])
                answers[6 * i + k] /= size
        answers = answers.T
        self._qpos[:], self._qvel[:] = place, base
        self._refresh()
        impulses = h * load[self.bodies].ravel()
        if not np.isfinite(answers).all():
            raise RobotDiverged(float(self.data.time), ["the answer to a probing impulse is not finite"])
        W = self._reciprocal(jacobian @ answers)
        self._mobility, self._joint_answers = W, answers
        foresight = Foresight(now, self.twists() - (W @ impulses).reshape(n, 6), W)
        self._take_back()
        return foresight

    def _take_back(self) -> None:
        """After trials: the state of `begin`, and what belongs to it. Trials spoil the frames, nothing else that is
        computed from positions."""
        if self._whole:
            self.restart()
        else:
            mujoco.mj_setState(self.model, self.data, self._start, STATE)
            self._refresh()

    def _integrate_trial(self) -> None:
        """The rest of the trial's step, from its wrenches to its velocities."""
        if self._whole:
            with uncontrolled():
                mujoco.mj_step(self.model, self.data)
        else:
            mujoco.mj_fwdAcceleration(self.model, self.data)
            mujoco.mj_fwdConstraint(self.model, self.data)
            self._integrate(self.model, self.data)

    def _jacobian(self) -> np.ndarray:
        """Twists of the bodies per joint velocity (6 B, nv)."""
        rows = []
        for body in self.bodies:
            linear, angular = np.empty((3, self.model.nv)), np.empty((3, self.model.nv))
            mujoco.mj_jacBodyCom(self.model, self.data, linear, angular, body)
            rows += [linear, angular]
        return np.concatenate(rows)

    def _reciprocal(self, W: np.ndarray) -> np.ndarray:
        """The symmetric, positive semi-definite part of a probed mobility.

        Where dry friction is about to give way one probe sticks and the next slides, and what they answer is neither;
        the step is then repeated if MuJoCo answers otherwise than this part.
        """
        W = 0.5 * (W + W.T)
        try:
            np.linalg.cholesky(W)  # a fifth of the time that eigenvalues take
        except np.linalg.LinAlgError:
            values, axes = np.linalg.eigh(W)
            W = (axes * np.maximum(values, 0.0)) @ axes.T
        return W

"""A copy of the MuJoCo state on which a step is tried out before it is taken."""

from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import mpm
from robosim.frames import body_pose

PROBE = 0.01
"""Probing impulse, as a share of what the body's weight gives in a step: within one state of sticking contacts."""
PROBE_ARM = 0.05
"""[m] at which the probing impulse pulls when it probes rotation."""
RANK = 1e-9
"""Share of the largest answer below which a direction counts as fixed."""


class Foresight(NamedTuple):
    """How the coupled bodies would move over the coming step, all in world axes about their centres of mass."""

    twists: np.ndarray
    """Now (B, 6): linear, angular."""
    free: np.ndarray
    """After the step, if no grain touched (B, 6)."""
    mobility: np.ndarray
    """Change of the twists after the step by impulses on the bodies (6 B, 6 B)."""


class Twin:
    """Tries steps of a MuJoCo scene without touching it.

    A step is `begin` (positions and velocities), any number of trials, and `finish`; together they are one `mj_step`.
    """

    def __init__(self, model: mujoco.MjModel, bodies: list[int]) -> None:
        self.model, self.bodies = model, bodies
        self._start, self._trial = mujoco.MjData(model), mujoco.MjData(model)
        # views of the trial's arrays: looking them up anew takes longer than what a probe computes
        self._qpos, self._qvel, self._qacc = self._trial.qpos, self._trial.qvel, self._trial.qacc
        self._act = self._trial.act
        self._warm, self._wrenches = self._trial.qacc_warmstart, self._trial.xfrc_applied
        # a Runge-Kutta step evaluates everything anew within it: such a step cannot be shared with its trials
        self._whole = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        euler = model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
        self._integrate = mujoco.mj_Euler if euler else mujoco.mj_implicit

    def begin(self, data: mujoco.MjData) -> None:
        """Evaluate positions and velocities, fresh even after the user changed qpos, and remember the state."""
        if self._whole:
            mujoco.mj_forward(self.model, data)
        else:
            mujoco.mj_step1(self.model, data)
        mujoco.mj_copyData(self._start, self.model, data)

    def restart(self, data: mujoco.MjData) -> None:
        """Back to the state after `begin`."""
        mujoco.mj_copyData(data, self.model, self._start)

    def finish(self, data: mujoco.MjData) -> None:
        """Step, with the forces that data holds now; frames and velocities are those after the step."""
        if self._whole:
            mujoco.mj_step(self.model, data)
        else:
            mujoco.mj_step2(self.model, data)
        self._refresh(data)

    def bring(self, data: mujoco.MjData, poses: dict[int, mpm.Pose]) -> None:
        """Move bodies (place among the twin's -> pose) the little way to poses, along what impulses on them would move,
        and keep their twists; the other bodies follow as they hang together.

        MuJoCo moves a body over a whole step with the velocity at its end, whenever in the step an impulse came.
        """
        offset, rows = [], [6 * i + k for i in poses for k in range(6)]
        for i, pose in poses.items():
            body, R = self.bodies[i], pose.matrix
            axes = data.xmat[self.bodies[i]].reshape(3, 3)
            centre = axes.T @ (data.xipos[body] - data.xpos[body])  # in the frame
            offset += [pose.position + R @ centre - data.xipos[body], Rotation.from_matrix(R @ axes.T).as_rotvec()]
        twists = self.twists(data)
        impulses = np.linalg.lstsq(self._mobility[rows], np.concatenate(offset), rcond=RANK)[0]
        mujoco.mj_integratePos(self.model, data.qpos, self._joint_answers @ impulses, 1.0)
        self._refresh(data)
        # the same joint velocities are another twist in the new place
        answers = (self._jacobian(data) @ self._joint_answers)[rows]
        change = (twists - self.twists(data)).ravel()[rows]
        data.qvel += self._joint_answers @ np.linalg.lstsq(answers, change, rcond=RANK)[0]
        mujoco.mj_comVel(self.model, data)

    def _refresh(self, data: mujoco.MjData) -> None:
        """Frames and velocities of the present positions."""
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_comVel(self.model, data)

    def poses_after(self, load: np.ndarray) -> list[mpm.Pose]:
        """Frames of the bodies after the step under wrenches (nbody, 6) besides the scene's own forces."""
        mujoco.mj_copyData(self._trial, self.model, self._start)
        self._trial.xfrc_applied += load
        self.finish(self._trial)
        return [body_pose(self._trial, body) for body in self.bodies]

    def twists(self, data: mujoco.MjData) -> np.ndarray:
        """Twists (B, 6) of the bodies about their centres of mass: linear, angular."""
        result, row = np.empty((len(self.bodies), 6)), np.empty(6)
        for i, body in enumerate(self.bodies):
            mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_BODY, body, row, 0)
            result[i, :3], result[i, 3:] = row[3:], row[:3]
        return result

    def foresee(self, load: np.ndarray) -> Foresight:
        """Probe the step about the wrenches (nbody, 6) that the grains are expected to put on the bodies.

        The answers hold arm posture, drives, joint friction and grasp as they are now, because it is MuJoCo's own step
        that answers.
        """
        trial, model, h = self._trial, self.model, self.model.opt.timestep
        masses = model.body_mass[self.bodies]
        now = self.twists(self._start)
        jacobian = self._jacobian(self._start)
        mujoco.mj_copyData(trial, model, self._start)
        self._wrenches += load
        if not self._whole:
            mujoco.mj_fwdActuation(model, trial)
        self._integrate_trial()
        base, place, warm = self._qvel.copy(), self._qpos.copy(), self._qacc.copy()
        loaded, n = self._wrenches.copy(), len(self.bodies)
        begin = self._start.qpos.copy(), self._start.qvel.copy(), self._start.act.copy()
        answers = np.empty((6 * n, model.nv))
        for i, body in enumerate(self.bodies):
            unit = PROBE * h * max(masses[i], 1e-6) * 9.81
            for k in range(6):
                size = unit if k < 3 else unit * PROBE_ARM
                if self._whole:
                    mujoco.mj_copyData(trial, model, self._start)
                else:
                    self._qpos[:], self._qvel[:], self._act[:] = begin
                    self._warm[:] = warm
                self._wrenches[:] = loaded
                self._wrenches[body, k] += size / h
                self._integrate_trial()
                np.subtract(self._qvel, base, out=answers[6 * i + k])
                answers[6 * i + k] /= size
        answers = answers.T
        self._qpos[:], self._qvel[:] = place, base
        self._refresh(trial)
        impulses = h * load[self.bodies].ravel()
        W = self._reciprocal(jacobian @ answers)
        self._mobility, self._joint_answers = W, answers
        return Foresight(now, self.twists(trial) - (W @ impulses).reshape(n, 6), W)

    def _integrate_trial(self) -> None:
        """The rest of the trial's step, from its wrenches to its velocities."""
        if self._whole:
            mujoco.mj_step(self.model, self._trial)
        else:
            mujoco.mj_fwdAcceleration(self.model, self._trial)
            mujoco.mj_fwdConstraint(self.model, self._trial)
            self._integrate(self.model, self._trial)

    def _jacobian(self, data: mujoco.MjData) -> np.ndarray:
        """Twists of the bodies per joint velocity (6 B, nv)."""
        rows = []
        for body in self.bodies:
            linear, angular = np.empty((3, self.model.nv)), np.empty((3, self.model.nv))
            mujoco.mj_jacBodyCom(self.model, data, linear, angular, body)
            rows += [linear, angular]
        return np.concatenate(rows)

    def _reciprocal(self, W: np.ndarray) -> np.ndarray:
        """The symmetric, positive semi-definite part of a probed mobility.

        Where dry friction is about to give way one probe sticks and the next slides, and what they answer is neither;
        the step is then repeated if MuJoCo answers otherwise than this part.
        """
        W = 0.5 * (W + W.T)
        values, axes = np.linalg.eigh(W)
        return W if values[0] >= 0 else (axes * np.maximum(values, 0.0)) @ axes.T

"""Mobility of the coupled bodies, probed from MuJoCo's own step."""

import mujoco
import numpy as np

import mpm
from mpm.geometry.rigid_motion import quaternion_of, relative_rotation
from robosim.base.errors import RobotDiverged
from robosim.coupling.trial_step import TrialStep

PROBE = 0.01
"""Probing impulse as a share of the body's weight times the step: small enough that sticking contacts stick."""
PROBE_ARM = 0.05
"""Lever arm [m] of the probing impulse for rotations."""
GRAVITY = 9.81
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
WELL_CONDITIONED = 1e7
"""Condition number up to which a matrix is inverted."""
RANK = 1e-9
"""Share of the largest singular value below which a direction of motion counts as constrained."""


class MobilityProbe:
    """Probes how the bodies of a `TrialStep` respond to impulses, with their drives, friction and grasp."""

    def __init__(self, trial: TrialStep) -> None:
        self.trial, self.model, self.data = trial, trial.model, trial.data
        data = trial.data
        # views: each access to an array of data takes longer than what a probe computes
        self._qpos, self._qvel, self._qacc = data.qpos, data.qvel, data.qacc
        plastic = [data.plastic] if hasattr(data, "plastic") else []  # from MuJoCo 4 on
        self._states = [data.qpos, data.qvel, data.act, *plastic]
        self._warmstart, self._wrenches = data.qacc_warmstart, data.xfrc_applied

    def predict(self, wrenches: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predict the step about the expected wrenches of the grains (nbody, 6).

        Returns the bodies' twists at its start (B, 6), linear [m/s] and angular [rad/s]; those at its end without any
        impulse of the grains (B, 6); and the change of the twists at its end by impulses on the bodies (6 B, 6 B), all
        in world axes about their centres of mass. The scene is left in the state after `TrialStep.begin`. Raises
        RobotDiverged for a response that is not finite."""
        n, h = len(self.trial.bodies), self.model.opt.timestep
        twists, jacobian = self.trial.twists(), self.trial.jacobian()
        responses = self._probe_joint_velocities(wrenches)
        impulses = h * wrenches[self.trial.bodies].ravel()
        if not np.isfinite(responses).all():
            raise RobotDiverged(float(self.data.time), ["the response to a probing impulse is not finite"])
        self._mobility, self._responses = jacobian @ responses, responses
        W = project_mobility(self._mobility)
        free_twists = self.trial.twists() - (W @ impulses).reshape(n, 6)
        self.trial.restore()
        return twists, free_twists, W

    def _probe_joint_velocities(self, wrenches: np.ndarray) -> np.ndarray:
        """Probe the change of the joint velocities (nv, 6 B) per impulse; leave the scene as after `wrenches` alone."""
        n, h = len(self.trial.bodies), self.model.opt.timestep
        masses = self.model.body_mass[self.trial.bodies]
        self._wrenches += wrenches
        loaded = self._wrenches.copy()
        start = [state.copy() for state in self._states]
        if not self.trial.is_whole:
            mujoco.mj_fwdActuation(self.model, self.data)
        self.trial.integrate_velocities()
        velocities, positions, warmstart = self._qvel.copy(), self._qpos.copy(), self._qacc.copy()
        responses = np.empty((6 * n, self.model.nv))
        for i, body in enumerate(self.trial.bodies):
            force_impulse = PROBE * h * max(masses[i], 1e-6) * GRAVITY
            for k in range(6):
                impulse = force_impulse if k < 3 else force_impulse * PROBE_ARM
                for state, value in zip(self._states, start):
                    state[:] = value
                self._warmstart[:] = warmstart
                self._wrenches[:] = loaded
                self._wrenches[body, k] += impulse / h
                self.trial.integrate_velocities()
                np.subtract(self._qvel, velocities, out=responses[6 * i + k])
                responses[6 * i + k] /= impulse
        self._qpos[:], self._qvel[:] = positions, velocities
        self.trial.update_frames()
        return responses.T

    def correct_poses(self, poses: dict[int, mpm.Pose]) -> None:
        """Move bodies to nearby poses and keep their twists.
        poses: index among the trial's bodies -> world pose. The displacement is one that impulses on these bodies would
        cause, so constraints hold and connected bodies follow. MuJoCo moves a body over the whole step with the
        velocity at its end, whenever in the step an impulse acted; the solver knows the true end."""
        data, offset, rows = self.data, [], [6 * i + k for i in poses for k in range(6)]
        for i, pose in poses.items():
            body, R = self.trial.bodies[i], pose.matrix
            axes = data.xmat[body].reshape(3, 3)
            centre = axes.T @ (data.xipos[body] - data.xpos[body])  # in the body's frame
            rotation = relative_rotation(IDENTITY, quaternion_of(R @ axes.T))
            offset += [pose.position + R @ centre - data.xipos[body], rotation]
        twists = self.trial.twists()
        impulses = solve_least(self._mobility[rows], np.concatenate(offset))
        mujoco.mj_integratePos(self.model, data.qpos, self._responses @ impulses, 1.0)
        self.trial.update_frames()
        # at the new positions the same joint velocities give another twist
        responses = (self.trial.jacobian() @ self._responses)[rows]
        change = (twists - self.trial.twists()).ravel()[rows]
        data.qvel += self._responses @ solve_least(responses, change)
        mujoco.mj_comVel(self.model, data)


def solve_least(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the least x, of those closest to A x = b; singular values below RANK of the largest count as zero."""
    if A.shape[0] == A.shape[1]:
        try:
            inverse = np.linalg.inv(A)  # a quarter of the time, where there is no direction to leave out
        except np.linalg.LinAlgError:
            inverse = np.full_like(A, np.inf)
        if np.abs(A).sum() * np.abs(inverse).sum() < WELL_CONDITIONED:
            return inverse @ b
    return np.linalg.lstsq(A, b, rcond=RANK)[0]


def project_mobility(W: np.ndarray) -> np.ndarray:
    """Return the symmetric, positive semi-definite part of a probed mobility (k, k).
    Where dry friction is at its limit one probe sticks and the next slides, and their responses are inconsistent; the
    step is then repeated if MuJoCo's motion differs from this part's."""
    W = 0.5 * (W + W.T)
    try:
        np.linalg.cholesky(W)  # a fifth of the cost of the eigenvalues
    except np.linalg.LinAlgError:
        values, axes = np.linalg.eigh(W)
        W = (axes * np.maximum(values, 0.0)) @ axes.T
    return W

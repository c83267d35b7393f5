"""Inverse kinematics of a pose by damped least squares, under joint limits."""

from typing import NamedTuple

import numpy as np
import pinocchio

from mpm import Pose
from robosim.robot.model import Arm

TOLERANCE = 1e-7
"""Position [m] and rotation [rad] error at which the iteration ends."""
IDENTITY = np.eye(6)
LIMIT_MARGIN = 1e-4
"""Least distance [rad] of a solution of `solve_pose` from the joint limits."""
TRACKING_LIMIT_MARGIN = 1e-3
"""The same for `step_towards`."""
REST_GAIN = 1e-3
"""Share of the difference to the rest posture by which `step_towards` moves the elbow."""


class Solution(NamedTuple):
    """Joint angles [rad] (n,) and the remaining errors [m], [rad]."""

    q: np.ndarray
    position_error: float
    angle_error: float

    @property
    def converged(self) -> bool:
        """Whether both errors are within ten times TOLERANCE."""
        return self.position_error < 10 * TOLERANCE and self.angle_error < 10 * TOLERANCE


def solve_pose(arm: Arm, target: Pose, start: np.ndarray, rest: np.ndarray | None = None,
               iterations: int = 200) -> Solution:
    """Find joint angles near `start` that put the tool at `target`.

    Takes Levenberg-Marquardt steps from start (n,) [rad]. target: world pose of the tool's frame. The redundant degree
    of freedom draws the posture towards `rest` (n,), by default the
    arm's home.
    """
    goal = pinocchio.SE3(target.matrix, np.asarray(target.position, float))
    q, rest = start.copy(), arm.home if rest is None else rest
    error = _compute_error(arm, q, goal)
    for _ in range(iterations):
        size = np.linalg.norm(error)
        if size < TOLERANCE:
            break
        J = arm.jacobian(q)
        damping = 1e-8 + 1e-3 * size**2  # vanishes at the goal, so that convergence stays quadratic
        rest_step = 0.05 * min(1.0, 10 * size) * (rest - q)
        step = rest_step + J.T @ np.linalg.solve(J @ J.T + damping * IDENTITY, error - J @ rest_step)
        step *= min(1.0, 0.3 / np.abs(step).max())
        q = np.clip(q + step, arm.lower + LIMIT_MARGIN, arm.upper - LIMIT_MARGIN)
        error = _compute_error(arm, q, goal)
    return Solution(q, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:])))


def step_towards(arm: Arm, target: Pose, q: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Take one damped step from q (n,) [rad] towards a slowly moving target.

    target: world pose of the tool's frame. Returns joint angles (n,) [rad].
    """
    error = _compute_error(arm, q, pinocchio.SE3(target.matrix, np.asarray(target.position, float)))
    J = arm.jacobian(q)
    damping = 1e-6 + 1e-3 * float(error @ error)
    rest_step = REST_GAIN * (rest - q)
    step = rest_step + J.T @ np.linalg.solve(J @ J.T + damping * IDENTITY, error - J @ rest_step)
    step *= min(1.0, 0.1 / max(float(np.abs(step).max()), 1e-12))
    return np.clip(q + step, arm.lower + TRACKING_LIMIT_MARGIN, arm.upper - TRACKING_LIMIT_MARGIN)


def _compute_error(arm: Arm, q: np.ndarray, target: pinocchio.SE3) -> np.ndarray:
    """Twist (6,) in the tool's axes that carries the tool to the target in unit time: linear, angular."""
    return pinocchio.log6(arm.tool_placement(q).actInv(target)).vector

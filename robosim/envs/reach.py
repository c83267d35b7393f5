"""What a commanded motion of the tool asks of the arm: joint speeds and ranges, and a penalty on what is too much.

No grains and no smoothing: joint angles q follow q' = J#(q) V, the damped inverse of the Jacobian, from the task's own
posture. Where the tool leaves the arm's reach, or goes through a singular posture, speeds grow beyond the limits.
"""

from typing import NamedTuple

import numpy as np

from mpm import Pose
from robosim.envs.arm_tool import start_posture
from robosim.errors import UnreachableWaypoint
from robosim.robot.inverse_kinematics import solve
from robosim.robot.model import SPEED_LIMITS, Arm
from robosim.tasks.task import TaskConfig

DAMPING = 1e-6
"""Added to J J^T: speeds stay finite in singular postures."""
SMALL = 1e-6
"""Step [rad] of the differences that give the inverse's own derivatives: exact to 1e-9."""


class Demands(NamedTuple):
    """Of every step: joint angles [rad] (n + 1, 7), joint speeds [rad/s] (n, 7)."""

    q: np.ndarray
    speeds: np.ndarray


class Reach:
    """An arm under a task's tool."""

    def __init__(self, task: TaskConfig) -> None:
        self._arm, self._dt = Arm(task.tool), task.step_dt
        self._rest = np.array(start_posture(task.model_dump_json()))
        self._middle = 0.5 * (self._arm.upper + self._arm.lower)
        self._half = 0.5 * (self._arm.upper - self._arm.lower)

    def demands(self, start: Pose, linear: np.ndarray, angular: np.ndarray) -> Demands:
        """Joint motion under world velocities of the tool, linear [m/s] and angular [rad/s], (n, 3) each, from a pose;
        raises UnreachableWaypoint where the arm cannot hold that."""
        posture = solve(self._arm, start, self._rest, rest=self._rest)
        if not posture.converged:
            raise UnreachableWaypoint("start", posture.position_error, np.degrees(posture.angle_error), 0.0)
        q, speeds = [posture.q], []
        for V in np.concatenate([linear, angular], 1):
            speeds.append(self._speeds(q[-1], V))
            q.append(q[-1] + self._dt * speeds[-1])
        return Demands(np.array(q), np.array(speeds))

    def told(self, start: Pose, linear: np.ndarray, angular: np.ndarray) -> dict[str, float]:
        """Largest speed and angle as shares of their limits, the first step [s] at which either is passed (-1: none),
        and how far [m] the arm's tool is from where it should be at the end."""
        found = self.demands(start, linear, angular)
        speeds = np.abs(found.speeds / SPEED_LIMITS).max(1)
        angles = np.abs((found.q - self._middle) / self._half).max(1)
        over = np.flatnonzero((speeds > 1.0) | (angles[1:] > 1.0))
        end = start.position + self._dt * linear.sum(0)
        miss = np.linalg.norm(self._arm.tool_pose(found.q[-1]).position - end)
        return {"speed_limit_ratio_max": float(speeds.max()), "joint_limit_ratio_max": float(angles.max()),
                "first_over": float(over[0] * self._dt) if len(over) else -1.0, "miss_at_the_end": float(miss)}

    def penalty(self, start: Pose, linear: np.ndarray,
                angular: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        """Mean over the steps of the squares by which joints pass their limits of speed and range, as shares of these,
        and its derivatives by linear and angular (n, 3)."""
        found, n, dt = self.demands(start, linear, angular), len(linear), self._dt
        fast = np.maximum(np.abs(found.speeds) / SPEED_LIMITS - 1.0, 0.0)
        offset = (found.q[1:] - self._middle) / self._half
        far = np.maximum(np.abs(offset) - 1.0, 0.0)
        by_speed = 2.0 / n * fast * np.sign(found.speeds) / SPEED_LIMITS
        by_angle = 2.0 / n * far * np.sign(offset) / self._half
        bars, later = np.zeros((n, 6)), np.zeros(7)  # later: derivative by the angles after the step
        twists = np.concatenate([linear, angular], 1)
        for k in reversed(range(n)):
            later = later + by_angle[k]
            answer = by_speed[k] + dt * later
            if not answer.any():
                continue
            bars[k] = self._inverse(found.q[k]).T @ answer
            slopes = [(self._speeds(found.q[k] + d, twists[k]) - self._speeds(found.q[k] - d, twists[k])) @ answer
                      for d in SMALL * np.eye(7)]
            later = later + np.array(slopes) / (2.0 * SMALL)
        return float((fast**2 + far**2).sum() / n), (bars[:, :3], bars[:, 3:])

    def _inverse(self, q: np.ndarray) -> np.ndarray:
        """Joint speeds by the tool's twist in world axes (7, 6)."""
        J = self._arm.jacobian(q)
        R = self._arm.placement(q).rotation
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = R.T
        return J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), turn)

    def _speeds(self, q: np.ndarray, V: np.ndarray) -> np.ndarray:
        return self._inverse(q) @ V

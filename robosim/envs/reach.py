"""Joint motion that an arm needs to carry a tool along a commanded motion, and a penalty on limits exceeded.
No grains and no smoothing: joint angles q follow q' = J#(q) V with the damped inverse of the Jacobian, from the task's
own start posture. Out of reach, or in a singular posture, the speeds exceed the limits."""

import numpy as np

from mpm import Pose
from robosim.base.errors import UnreachableWaypoint
from robosim.envs.arm_tool import IIWA, find_hold
from robosim.robot.inverse_kinematics import solve_pose
from robosim.robot.model import Arm
from robosim.scene.models import assemble
from robosim.tasks.task import TaskConfig

DAMPING = 1e-6
"""Added to J J^T, so that speeds stay finite in singular postures."""
DIFFERENCE = 1e-6
"""Step [rad] of the central differences that give the inverse's own derivatives, exact to 1e-9."""


class Reach:
    """An arm that carries a task's tool exactly as commanded."""

    def __init__(self, task: TaskConfig, robot: str = IIWA, gripper: str | None = None) -> None:
        turn, self._rest = find_hold(task.model_dump_json(), robot, gripper)
        self._arm, self._dt = Arm(assemble(task.tool, robot, gripper, turn)), task.step_dt
        self._middle = 0.5 * (self._arm.upper + self._arm.lower)
        self._half = 0.5 * (self._arm.upper - self._arm.lower)

    def joint_motion(self, start: Pose, linear: np.ndarray, angular: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joint angles [rad] (n + 1, joints) and speeds [rad/s] (n, joints) under tool velocities from a pose.
        linear [m/s] (n, 3), angular [rad/s] (n, 3): in world axes.
        Raises UnreachableWaypoint where the arm cannot reach the start."""
        posture = solve_pose(self._arm, start, self._rest, rest=self._rest)
        if not posture.converged:
            raise UnreachableWaypoint("start", posture.position_error, np.degrees(posture.angle_error), 0.0)
        q, speeds = [posture.q], []
        for V in np.concatenate([linear, angular], 1):
            speeds.append(self._speeds(q[-1], V))
            q.append(q[-1] + self._dt * speeds[-1])
        return np.array(q), np.array(speeds)

    def readings(self, start: Pose, linear: np.ndarray, angular: np.ndarray) -> dict[str, float]:
        """Return how far a motion uses the joints' limits.
        speed_limit_ratio_max, joint_limit_ratio_max: largest speed and angle over their limits.
        first_violation_time_s: of the first step above a limit, -1 without one. end_position_error_m: of the tool."""
        q, speeds = self.joint_motion(start, linear, angular)
        speeds = np.abs(speeds / self._arm.velocity).max(1)
        angles = np.abs((q - self._middle) / self._half).max(1)
        over = np.flatnonzero((speeds > 1.0) | (angles[1:] > 1.0))
        end = start.position + self._dt * linear.sum(0)
        error = np.linalg.norm(self._arm.tool_pose(q[-1]).position - end)
        return {"speed_limit_ratio_max": float(speeds.max()), "joint_limit_ratio_max": float(angles.max()),
                "first_violation_time_s": float(over[0] * self._dt) if len(over) else -1.0,
                "end_position_error_m": float(error)}

    def penalty(self, start: Pose, linear: np.ndarray,
                angular: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        """Return the penalty on exceeded joint limits and its derivatives with respect to linear and angular (n, 3).
        It is the mean over the steps of the squared excesses of speed and angle, as shares of their limits."""
        (q, speeds), n, dt = self.joint_motion(start, linear, angular), len(linear), self._dt
        fast = np.maximum(np.abs(speeds) / self._arm.velocity - 1.0, 0.0)
        offset = (q[1:] - self._middle) / self._half
        far = np.maximum(np.abs(offset) - 1.0, 0.0)
        by_speed = 2.0 / n * fast * np.sign(speeds) / self._arm.velocity
        by_angle = 2.0 / n * far * np.sign(offset) / self._half
        twists = np.concatenate([linear, angular], 1)
        twist_bar, q_bar = np.zeros((n, 6)), np.zeros(len(self._rest))  # q_bar: adjoint of the angles after a step
        for k in reversed(range(n)):
            q_bar = q_bar + by_angle[k]
            speed_bar = by_speed[k] + dt * q_bar
            if not speed_bar.any():
                continue
            twist_bar[k] = self._inverse(q[k]).T @ speed_bar
            gradient = [(self._speeds(q[k] + d, twists[k]) - self._speeds(q[k] - d, twists[k])) @ speed_bar
                        for d in DIFFERENCE * np.eye(len(self._rest))]
            q_bar = q_bar + np.array(gradient) / (2.0 * DIFFERENCE)
        return float((fast**2 + far**2).sum() / n), (twist_bar[:, :3], twist_bar[:, 3:])

    def _inverse(self, q: np.ndarray) -> np.ndarray:
        """Return the matrix (n, 6) from the tool's twist in world axes to joint speeds."""
        J = self._arm.jacobian(q)
        R = self._arm.tool_placement(q).rotation
        to_tool_axes = np.zeros((6, 6))
        to_tool_axes[:3, :3] = to_tool_axes[3:, 3:] = R.T
        return J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), to_tool_axes)

    def _speeds(self, q: np.ndarray, V: np.ndarray) -> np.ndarray:
        return self._inverse(q) @ V

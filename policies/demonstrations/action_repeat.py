"""Actions as twists of a task's tool, step by step, and derivatives by twists as derivatives by actions."""

from typing import Any

import numpy as np

from robosim.tasks.actions import follow, move_pose


class ActionRepeat:
    """The map from actions (decisions, dimensions) in [-1, 1] to the tool's twists in every step of an episode.
    Each action is repeated for `action_repeat` steps. As in the environment, the tool's origin stays within the task's
    box. The first three dimensions are linear velocity, three more, where a task has them, angular velocity."""

    def __init__(self, task: Any, action_repeat: int) -> None:
        action = task.action
        self.steps, self.action_repeat, self.dt = task.steps, action_repeat, task.step_dt
        self.decisions, self.dimensions = -(-task.steps // action_repeat), action.dimensions
        self.shape = (self.decisions, self.dimensions)
        self.lower, self.upper = np.array(action.lower), np.array(action.upper)
        """Bounds of the origin [m] (3,)."""
        self.start = np.array(task.start.position)
        """Origin of the tool before the first step [m] (3,)."""
        self.unclipped = np.ones((task.steps, 3), bool)
        """Where the twists that `to_twists` was last called with left the origin within the box."""
        self._speeds = np.array([action.speed] * 3 + [action.angular_speed] * (action.dimensions - 3))

    def set_start(self, position: np.ndarray) -> None:
        """Set the tool's origin before the first step [m] (3,)."""
        self.start = np.asarray(position, float)

    def follow_script(self, task: Any, until: float) -> np.ndarray:
        """Return actions of shape `shape` that follow the task's script up to a time [s], and are zero after it."""
        script, pose, actions = task.scripted_path(self.start), task.start.pose, np.zeros(self.shape)
        pose = pose._replace(position=self.start)
        for k in range(self.decisions):
            steps = min(self.action_repeat, self.steps - k * self.action_repeat)
            begin, duration = k * self.action_repeat * self.dt, steps * self.dt
            if begin + duration > until + 1e-9:
                break
            actions[k] = follow(task, script, pose, begin, duration)[: self.dimensions]
            linear, angular = np.split(np.pad(steps * self._speeds * actions[k], (0, 6 - self.dimensions)), 2)
            pose = move_pose(pose, task, linear, angular)
        return actions

    def to_twists(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return linear [m/s] and angular [rad/s] velocities of every step, world axes, (steps, 3) each."""
        commanded = np.repeat(actions * self._speeds, self.action_repeat, axis=0)[: self.steps]
        positions = np.empty((self.steps + 1, 3))
        positions[0] = self.start
        for k in range(self.steps):
            target = positions[k] + self.dt * commanded[k, :3]
            positions[k + 1] = np.clip(target, self.lower, self.upper)
            self.unclipped[k] = positions[k + 1] == target
        angular = commanded[:, 3:] if self.dimensions == 6 else np.zeros((self.steps, 3))
        return np.diff(positions, axis=0) / self.dt, angular

    def pull_back(self, linear_bar: np.ndarray, angular_bar: np.ndarray) -> np.ndarray:
        """Return the adjoint of the actions from those of the twists (steps, 3), at the actions last converted.
        A coordinate that the box clipped has no influence through its own step."""
        commanded_bar = np.zeros((self.steps, self.dimensions))
        position_bar = np.zeros(3)  # of the origin after the step, through the steps that follow
        for k in reversed(range(self.steps)):
            target_bar = np.where(self.unclipped[k], position_bar + linear_bar[k] / self.dt, 0.0)
            commanded_bar[k, :3] = self.dt * target_bar
            position_bar = target_bar - linear_bar[k] / self.dt
        if self.dimensions == 6:
            commanded_bar[:, 3:] = angular_bar
        padded = np.zeros((self.decisions * self.action_repeat, self.dimensions))
        padded[: self.steps] = commanded_bar
        return padded.reshape(self.decisions, self.action_repeat, self.dimensions).sum(1) * self._speeds

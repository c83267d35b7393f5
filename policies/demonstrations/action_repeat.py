"""Actions of a sub-task held for some steps, as twists of its tool, and derivatives the way back."""

from typing import Any

import numpy as np

from mpm.geometry.rigid_motion import quaternion_of, relative_rotation, rotation_matrix


class Hold:
    """Actions (n, dimensions) in [-1, 1], each held for `hold` steps of an episode; the tool's origin stays in its box,
    as the environment keeps it."""

    def __init__(self, task: Any, hold: int) -> None:
        action = task.action
        self.steps, self.hold, self.dt = task.steps, hold, task.step_dt
        self.n, self.dimensions = -(-task.steps // hold), action.dimensions
        self.shape = (self.n, self.dimensions)
        self._speeds = np.array([action.speed] * 3 + [action.angular_speed] * (action.dimensions - 3))
        self._low, self._high = np.array(action.lower), np.array(action.upper)
        self._start = np.array(task.start.position)
        self._free = np.ones((task.steps, 3), bool)

    def begin(self, place: np.ndarray) -> None:
        """Where the tool's origin is at the start [m] (3,)."""
        self._start = np.asarray(place, float)

    def follow(self, task: Any, until: float) -> np.ndarray:
        """Actions of shape `shape` that keep to the task's script up to a time [s], and rest from then on."""
        way, matrix = task.scripted_path(self._start), task.start.pose.matrix
        place, actions = self._start, np.zeros(self.shape)
        for k in range(self.n):
            begin = k * self.hold * self.dt
            held = min(self.hold, self.steps - k * self.hold) * self.dt
            if begin + held > until + 1e-9:
                break
            wanted = way.pose(begin + held)
            action = (wanted.position - place) / held
            if self.dimensions == 6:
                action = np.append(action, matrix @ relative_rotation(quaternion_of(matrix), wanted.quaternion) / held)
            actions[k] = np.clip(action / self._speeds, -1.0, 1.0)
            place = np.clip(place + held * (self._speeds * actions[k])[:3], self._low, self._high)
            if self.dimensions == 6:
                matrix = rotation_matrix(held * (self._speeds * actions[k])[3:]) @ matrix
        return actions

    def twists(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of every step, linear [m/s] and angular [rad/s], (steps, 3) each."""
        asked = np.repeat(actions * self._speeds, self.hold, axis=0)[: self.steps]
        places = np.empty((self.steps + 1, 3))
        places[0] = self._start
        for k in range(self.steps):
            wanted = places[k] + self.dt * asked[k, :3]
            places[k + 1] = np.clip(wanted, self._low, self._high)
            self._free[k] = places[k + 1] == wanted
        angular = asked[:, 3:] if self.dimensions == 6 else np.zeros((self.steps, 3))
        return np.diff(places, axis=0) / self.dt, angular

    def back(self, by_linear: np.ndarray, by_angular: np.ndarray) -> np.ndarray:
        """Derivatives by the actions that `twists` was last given: none of a step that the box cut off."""
        by_asked = np.zeros((self.steps, self.dimensions))
        place = np.zeros(3)  # derivative by the place after the step, through the steps that follow
        for k in reversed(range(self.steps)):
            wanted = np.where(self._free[k], place + by_linear[k] / self.dt, 0.0)
            by_asked[k, :3] = self.dt * wanted
            place = wanted - by_linear[k] / self.dt
        if self.dimensions == 6:
            by_asked[:, 3:] = by_angular
        padded = np.zeros((self.n * self.hold, self.dimensions))
        padded[: self.steps] = by_asked
        return padded.reshape(self.n, self.hold, self.dimensions).sum(1) * self._speeds

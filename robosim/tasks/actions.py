"""Actions of a sub-task: their space, their check, and the tool velocities that they stand for."""

from typing import Any

import gymnasium
import numpy as np

import mpm
from mpm.geometry.rigid_motion import relative_rotation, rotate
from robosim.base.errors import ConfigError
from robosim.tasks.task import ScriptedPath, TaskConfig

AXES = ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z")
"""Names of an action's motions, for messages."""
SHAKING = ("amplitude", "frequency")
"""Names of the two numbers of a vibration, after them."""


def check_action_repeat(action_repeat: int) -> int:
    """Return the steps that an action is repeated for; raises ConfigError unless it is a whole number from 1 on."""
    if not isinstance(action_repeat, int | np.integer) or action_repeat < 1:
        raise ConfigError(f"action_repeat = {action_repeat!r}; accepted: a whole number from 1 on")
    return int(action_repeat)


Velocity = tuple[np.ndarray, ...]
"""Linear [m/s] (3,) and angular [rad/s] (3,) velocity of the tool, in world axes; where it can vibrate, also amplitude
[m] and frequency [Hz] (2,)."""
AT_REST: Velocity = (np.zeros(3), np.zeros(3))
"""Of a tool that cannot vibrate."""
LONGEST_DELAY = 10.0
"""[s]"""


def delay_steps(delay: float, step_dt: float) -> int:
    """Return the steps of a delay [s]; raises ConfigError for one that is no multiple of step_dt [s]."""
    steps = round(delay / step_dt) if 0.0 <= delay <= LONGEST_DELAY else -1
    if steps < 0 or abs(steps * step_dt - delay) > 1e-6:
        raise ConfigError(f"action_delay = {delay} s; accepted: 0 to {LONGEST_DELAY:g} s, a multiple of {step_dt:g} s")
    return steps


def move_pose(pose: mpm.Pose, task: TaskConfig, linear: np.ndarray, angular: np.ndarray) -> mpm.Pose:
    """Move a pose by one step of velocities [m/s], [rad/s] in world axes; the origin stays in the task's box."""
    position = np.clip(pose.position + task.step_dt * linear, task.action.lower, task.action.upper)
    return mpm.Pose(position, rotate(pose.quaternion, task.step_dt * angular))


def rest_action(task: TaskConfig) -> np.ndarray:
    """Return the action (size,) of a tool at rest, which does not vibrate either."""
    n = task.action.dimensions
    return np.array([0.0] * n + [-1.0] * (task.action.size - n), np.float32)


def follow(task: TaskConfig, path: ScriptedPath, now: mpm.Pose, time: float, duration: float,
           closing: float = 0.0) -> np.ndarray:
    """Return the action (size,) that a tool with a pose takes along a path, for a duration [s] from a time [s] on.
    closing: time constant [s] of the distance from the path; one below the duration: the tool is there at its end."""
    def way(moment: float) -> np.ndarray:
        """Displacement [m], [rad] (6,) from the present pose to that of the path, in world axes."""
        target = path.pose(moment)
        turn = now.matrix @ relative_rotation(now.quaternion, target.quaternion)
        return np.concatenate([target.position - now.position, turn])

    action = task.action
    kept = max(1.0 - duration / closing, 0.0) if closing else 0.0
    velocity = (way(time + duration) - (kept * way(time) if kept else 0.0)) / duration
    share = velocity / np.repeat([action.speed, action.angular_speed], 3)
    return np.clip(np.append(share[: action.dimensions], rest_action(task)[action.dimensions :]), -1.0, 1.0)


class DelayLine:
    """Velocities that were commanded and that the robot has yet to carry out; at rest in the beginning.
    steps: for which each is delayed. rest: what is carried out until then."""

    def __init__(self, steps: int, rest: Velocity = AT_REST) -> None:
        self.steps, self._rest = steps, rest
        self.restart()

    def restart(self) -> None:
        """Begin an episode."""
        self.waiting: list[tuple[Any, ...]] = [(*self._rest, self.steps)] if self.steps else []
        """Velocities with the steps that each will last."""

    def push(self, velocity: Velocity, steps: int) -> list[tuple[Any, ...]]:
        """Command a velocity for some steps; return the velocities that are carried out in them, with their steps."""
        self.waiting.append((*velocity, steps))
        due: list[tuple[Any, ...]] = []
        while steps:
            *first, left = self.waiting.pop(0)
            now = min(left, steps)
            due.append((*first, now))
            if left > now:
                self.waiting.insert(0, (*first, left - now))
            steps -= now
        return due


class ActionScaling:
    """The action space of a sub-task; clip: finite values outside -1 to 1 are clipped, otherwise they are refused."""

    def __init__(self, task: TaskConfig, *, clip: bool = False) -> None:
        action, n = task.action, task.action.dimensions
        self.space, self.clip = gymnasium.spaces.Box(-1.0, 1.0, (action.size,), np.float32), clip
        self._scale = np.array([action.speed] * 3 + [action.angular_speed] * (n - 3))
        self._names, self._vibration = AXES[:n] + SHAKING, action.vibration
        self.rest: Velocity = AT_REST if action.vibration is None else (*AT_REST, np.zeros(2))
        """Velocities of a tool at rest."""

    def velocities(self, action: np.ndarray, name: str = "action") -> Velocity:
        """Convert an action (size,) to velocities of the tool; name: what messages call the action.
        Raises ConfigError for a wrong shape or dtype, and for a component outside -1 to 1."""
        values = np.asarray(action)
        if values.shape != self.space.shape:
            raise ConfigError(f"{name} has shape {values.shape}; accepted: {self.space.shape}")
        if not np.issubdtype(values.dtype, np.floating):
            raise ConfigError(f"{name} has dtype {values.dtype}; accepted: floating-point numbers")
        bad = np.flatnonzero(~(np.abs(values) <= 1.0))
        if len(bad) and (not self.clip or not np.all(np.isfinite(values))):
            raise ConfigError(f"{name}[{bad[0]}] ({self._names[bad[0]]}) = {values[bad[0]]}; accepted: -1 to 1 "
                              f"(clip_actions=True clips finite values)")
        numbers, n = np.clip(values.astype(float), -1.0, 1.0), len(self._scale)
        velocity = numbers[:n] * self._scale
        motion = velocity[:3], velocity[3:] if n == 6 else np.zeros(3)
        if self._vibration is None:
            return motion
        share, (low, high) = 0.5 * (numbers[n:] + 1.0), self._vibration.frequency
        return *motion, np.array([self._vibration.amplitude * share[0], low + (high - low) * share[1]])

"""Actions: checked, and scaled to velocities of the tool."""

import gymnasium
import numpy as np

from robosim.errors import ConfigError
from robosim.tasks.task import TaskConfig

AXES = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


def checked_repeat(action_repeat: int) -> int:
    """Steps that an action is held for; raises ConfigError for what is no such number."""
    if not isinstance(action_repeat, int | np.integer) or action_repeat < 1:
        raise ConfigError(f"action_repeat = {action_repeat!r}; accepted: a whole number from 1 on")
    return int(action_repeat)


class Actions:
    """The action space of a sub-task, and what its numbers mean. clip: values outside are clipped, not refused."""

    def __init__(self, task: TaskConfig, *, clip: bool = False) -> None:
        n = task.action.dimensions
        self.space, self.clip = gymnasium.spaces.Box(-1.0, 1.0, (n,), np.float32), clip
        self._scale = np.array([task.action.speed] * 3 + [task.action.angular_speed] * (n - 3))

    def velocities(self, action: np.ndarray, whose: str = "action") -> tuple[np.ndarray, np.ndarray]:
        """Linear [m/s] (3,) and angular [rad/s] (3,) velocity, or an error that names the component."""
        given = np.asarray(action)
        if given.shape != self.space.shape:
            raise ConfigError(f"{whose} has shape {given.shape}; accepted: {self.space.shape}")
        if not np.issubdtype(given.dtype, np.floating):
            raise ConfigError(f"{whose} has dtype {given.dtype}; accepted: floating-point numbers")
        bad = np.flatnonzero(~(np.abs(given) <= 1.0))
        if len(bad) and (not self.clip or not np.all(np.isfinite(given))):
            raise ConfigError(f"{whose}[{bad[0]}] ({AXES[bad[0]]}) = {given[bad[0]]}; accepted: -1 to 1 "
                              f"(clip_actions=True clips what is finite)")
        velocity = np.clip(given.astype(float), -1.0, 1.0) * self._scale
        return velocity[:3], velocity[3:] if len(velocity) == 6 else np.zeros(3)

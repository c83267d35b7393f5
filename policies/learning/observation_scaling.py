"""Observations in units of the task, of order one, as networks like them."""

from typing import Any

import gymnasium
import numpy as np

LENGTH = 0.1
"""[m]"""


class Scaled(gymnasium.ObservationWrapper):
    """Flat observations of a sub-task: places from its goal in decimetres, velocities in the tool's top speed, time
    from -1 to 1. Layouts that are not made of these are left as they are."""

    def __init__(self, env: gymnasium.Env, layout: str) -> None:
        super().__init__(env)
        raw: Any = env.unwrapped
        self.offset, self.factor = units(raw, layout)
        space = raw.observation_space
        low, high = ((bound - self.offset) * self.factor for bound in (space.low, space.high))
        self.observation_space = gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32))

    def observation(self, observation: Any) -> np.ndarray:
        """In these units."""
        return ((observation - self.offset) * self.factor).astype(np.float32)


def units(env: Any, layout: str) -> tuple[np.ndarray, np.ndarray]:
    """What to take away from an environment's observations, and what to multiply the rest with."""
    n = env.observation_space.shape[0]
    offset, factor = np.zeros(n), np.ones(n)
    place, speed = np.array(env.task.goal), env.task.action.speed
    for name, part in env.observation_slices.items():
        if name == "particles" and layout in ("flat", "all"):
            count = (part.stop - part.start) // 6
            offset[part] = np.tile([*place, 0.0, 0.0, 0.0], count)
            factor[part] = np.tile([1.0 / LENGTH] * 3 + [1.0 / speed] * 3, count)
        elif name == "particles" and layout == "positions":
            offset[part] = np.tile(place, (part.stop - part.start) // 3)
            factor[part] = 1.0 / LENGTH
        elif name == "particles" or name in ("velocity", "velocity_spread"):
            factor[part] = 1.0 / speed
        elif name == "tool":
            offset[part.start : part.start + 3], factor[part.start : part.start + 3] = place, 1.0 / LENGTH
        elif name == "time":
            offset[part], factor[part] = 0.5, 2.0
        elif name == "centre":
            offset[part], factor[part] = place, 1.0 / LENGTH
        elif name == "extent":
            offset[part], factor[part] = np.tile(place, 2), 1.0 / LENGTH
        elif name in ("from_goal", "in_tool_frame", "clearance"):
            factor[part] = 1.0 / LENGTH
        elif name == "covariance":
            factor[part] = 1.0 / LENGTH**2
    return offset, factor

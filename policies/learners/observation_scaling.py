"""Observations in units of the task, of order one, which networks learn from best."""

from typing import Any

import gymnasium
import numpy as np

LENGTH = 0.1
"""Unit of length [m]."""


class ScaledObservation(gymnasium.ObservationWrapper):
    """Flat observations of a sub-task in units of the task.

    Positions relative to the goal in decimetres, velocities in units of the tool's top speed, time from -1 to 1. Parts
    of other kinds are left unchanged.
    """

    def __init__(self, env: gymnasium.Env, layout: str) -> None:
        super().__init__(env)
        raw: Any = env.unwrapped
        self.offset, self.factor = observation_units(raw, layout)
        space = raw.observation_space
        low, high = ((bound - self.offset) * self.factor for bound in (space.low, space.high))
        self.observation_space = gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32))

    def observation(self, observation: Any) -> np.ndarray:
        """Return the scaled observation (n,)."""
        return ((observation - self.offset) * self.factor).astype(np.float32)


def observation_units(env: Any, layout: str) -> tuple[np.ndarray, np.ndarray]:
    """Return offset and factor (n,) of a scaled observation: (observation - offset) * factor."""
    n = env.observation_space.shape[0]
    offset, factor = np.zeros(n), np.ones(n)
    goal, speed = np.array(env.task.goal), env.task.action.speed
    for name, part in env.observation_slices.items():
        if name == "particles" and layout in ("flat", "all"):
            count = (part.stop - part.start) // 6
            offset[part] = np.tile([*goal, 0.0, 0.0, 0.0], count)
            factor[part] = np.tile([1.0 / LENGTH] * 3 + [1.0 / speed] * 3, count)
        elif name == "particles" and layout == "positions":
            offset[part] = np.tile(goal, (part.stop - part.start) // 3)
            factor[part] = 1.0 / LENGTH
        elif name == "particles" or name in ("velocity", "velocity_spread"):
            factor[part] = 1.0 / speed
        elif name == "tool":
            offset[part.start : part.start + 3], factor[part.start : part.start + 3] = goal, 1.0 / LENGTH
        elif name == "time":
            offset[part], factor[part] = 0.5, 2.0
        elif name == "centre":
            offset[part], factor[part] = goal, 1.0 / LENGTH
        elif name == "extent":
            offset[part], factor[part] = np.tile(goal, 2), 1.0 / LENGTH
        elif name in ("from_goal", "in_tool_frame", "clearance"):
            factor[part] = 1.0 / LENGTH
        elif name == "covariance":
            factor[part] = 1.0 / LENGTH**2
    return offset, factor

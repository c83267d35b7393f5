"""Wrappers of environments: observations in units of the task, and actions that correct a motion or an expert."""

from functools import partial
from itertools import chain, repeat
from typing import Any, cast

import gymnasium
import numpy as np
from torch import nn

import mpm
from robosim.envs.grain_env import GrainEnv
from robosim.senses.grains import GOAL_FRAME
from robosim.studies.policies.script import ScriptedPolicy

LENGTH = 0.1
"""Unit of length [m]."""
INITIAL_NOISE = 0.2
"""Standard deviation of a residual policy's actions before learning."""


class ScaledObservation(gymnasium.ObservationWrapper):
    """Flat observations of a sub-task in units of the task.
    Positions relative to the goal in decimetres, velocities in units of the tool's top speed, time from -1 to 1. Parts
    of other kinds are left unchanged. grains_as_one: whether the columns of n grains are divided by sqrt(n)."""

    def __init__(self, env: gymnasium.Env, layout: str, grains_as_one: bool = False) -> None:
        super().__init__(env)
        raw: Any = env.unwrapped
        self.offset, self.factor = observation_units(raw, layout)
        if grains_as_one and "particles" in raw.observation_slices:
            part = raw.observation_slices["particles"]
            self.factor[part] /= max(len(raw.world.observer.grains), 1) ** 0.5
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
    goal, far, fast = np.array(env.task.goal), 1.0 / LENGTH, 1.0 / env.task.action.speed
    grains = {"flat": 6, "all": 6, "positions": 3}.get(layout, 0)  # columns of a grain that begin with its position
    factors = {"velocity": fast, "velocity_spread": fast, "time": 2.0, "covariance": far**2} | dict.fromkeys(
        ("centre", "extent", "from_goal", "in_tool_frame", "clearance", "goal", "height_map", "depth"), far)
    for name, part in env.observation_slices.items():
        length = part.stop - part.start
        if name == "goal_frame":
            factor[part] = np.repeat([1.0 if one in ("tool_axes", "axes", "shares") else factors.get(one, far)
                                      for one in GOAL_FRAME], list(GOAL_FRAME.values()))
        elif name == "particles":
            offset[part] = np.tile(np.append(goal, np.zeros(3))[:grains], length // grains) if grains else 0.0
            factor[part] = np.tile([far] * 3 + [fast] * 3, -(-length // 6))[:length] if grains == 6 else \
                far if grains else fast
        elif name == "tool":
            offset[part.start : part.start + 3], factor[part.start : part.start + 3] = goal, far
        else:
            offset[part] = np.tile(goal, length // 3) if name in ("centre", "extent") else 0.5 * (name == "time")
            factor[part] = factors.get(name, 1.0)
    return offset, factor


class ResidualActionWrapper(gymnasium.ActionWrapper):
    """Adds an action, scaled by `share`, to that of a base policy, and clips the sum to -1 .. 1.

    Source: residual policies, Silver et al. 2018. base: a motion (decisions, dimensions), whose last action is repeated
    after its end; None: the script that knows the target's place.

    Each decision costs `cost` x the mean square of its action: in states that the critics have not visited, the
    base policy is to be preferred."""

    def __init__(self, env: gymnasium.Env, base: np.ndarray | None, share: float, cost: float = 0.0) -> None:
        super().__init__(env)
        self._base, self._share, self._cost = base, share, cost

    def reset(self, **options: Any) -> Any:
        """Reset the environment and restart the base policy."""
        result, raw = self.env.reset(**options), self.env.unwrapped
        self._next: Any = chain(self._base, repeat(self._base[-1])).__next__ if self._base is not None else \
            partial(ScriptedPolicy(cast(GrainEnv, raw), knows=True), None)
        return result

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step with the corrected action; the reward is reduced by the cost."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, float(reward) - self._cost * float(np.mean(np.square(action))), terminated, truncated, info

    def action(self, action: np.ndarray) -> np.ndarray:
        """Return the corrected action (dimensions,)."""
        return np.clip(self._next() + self._share * action, -1.0, 1.0).astype(np.float32)


def zero_residual(model: Any, learner: str) -> None:
    """Initialise a policy to make no correction, with small noise.
    With the usual initialisation the first episodes would leave the motion that is to be corrected, and the critics
    would learn from these alone. Raises mpm.InvalidValue for a policy without a state-dependent standard deviation."""
    actor = getattr(model, "actor", None)
    if actor is None or not isinstance(getattr(actor, "log_std", None), nn.Linear):
        raise mpm.InvalidValue(f"residual with learner {learner}; accepted: SAC, TQC or CrossQ, without use_sde")
    for layer, value in ((actor.mu, 0.0), (actor.log_std, float(np.log(INITIAL_NOISE)))):
        nn.init.zeros_(layer.weight)
        nn.init.constant_(layer.bias, value)

"""Playing episodes: the one loop of everybody who steps an environment with a policy."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np


class Transition(NamedTuple):
    """One decision and its outcome."""

    observation: Any
    next_observation: Any
    action: np.ndarray
    """(dimensions,)"""
    reward: float
    done: bool
    """terminated or truncated"""
    info: dict[str, Any]
    """With "TimeLimit.truncated", whether the episode was truncated and not terminated."""


Actions = np.ndarray | Callable[[Any], np.ndarray]
"""A motion (decisions, dimensions), or a policy that is called with each observation."""
Hook = Callable[[Transition], object]
"""Called with every transition, as by a recorder."""


def run_episode(env: gymnasium.Env, actions: Actions, *, seed: int | None = None,
                options: dict[str, Any] | None = None) -> Iterator[Transition]:
    """Reset an environment and yield the transitions of one episode, each as it is made.
    The episode ends where the environment ends it, or after a motion's last action. seed, options: of the reset."""
    observation, _ = env.reset(seed=seed, options=options)
    yield from continue_episode(env, actions, observation)


def continue_episode(env: gymnasium.Env, actions: Actions, observation: Any) -> Iterator[Transition]:
    """Yield the transitions of an episode from its present observation on."""
    motion = iter(()) if callable(actions) else iter(actions)
    while True:
        action = actions(observation) if callable(actions) else next(motion, None)
        if action is None:
            return
        next_observation, reward, terminated, truncated, info = env.step(action)
        info["TimeLimit.truncated"] = truncated and not terminated
        done = terminated or truncated
        yield Transition(observation, next_observation, action, float(reward), done, info)
        if done:
            return
        observation = next_observation


def play(env: gymnasium.Env, actions: Actions, *, observation: Any = None, hooks: Sequence[Hook] = (),
         seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[float, dict[str, Any]]:
    """Play an episode to its end and return the sum of its rewards and its last info.
    observation: the present one of an environment that was reset; None: it is reset, with seed and options."""
    if observation is None:
        observation, _ = env.reset(seed=seed, options=options)
    total, info = 0.0, {}
    for step in continue_episode(env, actions, observation):
        total, info = total + step.reward, step.info
        for hook in hooks:
            hook(step)
    return total, info


def read_scores(info: dict[str, Any]) -> dict[str, Any]:
    """Return score, success and readings of a sub-task's info; nothing of another environment's."""
    return {"tcs": info["tcs"], "is_success": bool(info["is_success"]), **info["readings"]} if "tcs" in info else {}

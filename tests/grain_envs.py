"""Environments that tests make and play, and whether two results are the same to the bit."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import mpm
import robosim  # noqa: F401  (registers the environments)
from robosim.envs.grain_env import GrainEnv
from robosim.senses.perception import Perception
from robosim.senses.term import SenseScene
from robosim.studies.policies.make import make_policy


def make(name: str, **options: Any) -> GrainEnv:
    """Return the environment of a task without wrappers."""
    env: Any = gymnasium.make(f"robosim/{name}-v0", disable_env_checker=True, **options).unwrapped
    return env


def make_vector(name: str, num_envs: int = 3, workers: int | None = 1, **options: Any) -> Any:
    """Return a vector environment of a task, in this process unless `workers` says otherwise."""
    return gymnasium.make_vec(f"robosim/{name}-v0", num_envs=num_envs, workers=workers, **options)


def play(env: GrainEnv, policy: str | Callable = "scripted", seed: int = 0, **reset: Any) -> tuple[float, dict, list]:
    """Return the return of an episode, its last info, and its observations; policy: a name, or what gives an action.

    Observations must be in their space, and rewards the sums of their terms."""
    observation, info = env.reset(seed=seed, **reset)
    act = make_policy(policy, env, seed) if isinstance(policy, str) else policy
    total, over, seen = 0.0, False, [observation]
    while not over:
        observation, reward, terminated, truncated, info = env.step(act(observation))
        assert env.observation_space.contains(observation) and abs(reward - sum(info["reward_terms"].values())) < 1e-9
        total, over = total + reward, terminated or truncated
        seen.append(observation)
    return total, info, seen


def observe(env: GrainEnv, layout: Any) -> tuple[Perception, Any]:
    """Return what reads a layout, and the present state in it."""
    perception = Perception(env.task, layout)
    perception.build(SenseScene(env.task, env.material, env.solver))
    grains = mpm.Sample(env.solver, perception.grains).read() if layout != "none" else np.zeros((0, 6), np.float32)
    sight = env.member.look(grains)
    return perception, perception.read(sight, perception.begin(sight, 0))


def same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray) and not one.dtype.hasobject:
        return one.dtype == other.dtype and one.tobytes() == other.tobytes()
    return same(list(one), list(other)) if isinstance(one, np.ndarray) else one == other

"""Policies that need no learning: do nothing, act at random, follow the task's script, replay recorded actions."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mpm.motion import relative_rotation
from robosim.envs.grain_env import GrainEnv
from robosim.errors import ConfigError, UnknownName

NAMES = ("zero", "random", "scripted")
Policy = Callable[[], np.ndarray]
"""The next action of the episode."""


def policy(name: str, env: GrainEnv, seed: int) -> Policy:
    """The policy of one episode, by name or from a .npz file with the array `actions` (n, dimensions)."""
    n = env.task.action.dimensions
    if name == "zero":
        return lambda: np.zeros(n, np.float32)
    if name == "random":
        rng = np.random.default_rng(seed)
        return lambda: rng.uniform(-1.0, 1.0, n).astype(np.float32)
    if name == "scripted":
        return Script(env)
    if Path(name).is_file():
        return Replay(Path(name), n, env.action_repeat)
    raise UnknownName("policy", name, NAMES, "or the path of a .npz file with an array `actions`")


class Script:
    """Follows the poses of the task's script: smooth in time between them."""

    def __init__(self, env: GrainEnv) -> None:
        self._env, self._way = env, env.task.way(env.carrier.commanded.position)

    def __call__(self) -> np.ndarray:
        env, task, action = self._env, self._env.task, self._env.task.action
        now = env.carrier.commanded
        held = min(env.action_repeat, task.steps - env.step_count) * task.step_dt
        wanted = self._way.pose(env.step_count * task.step_dt + held)
        velocity = (wanted.position - now.position) / (held * action.speed)
        if action.dimensions == 6:
            turn = now.matrix @ relative_rotation(now.quaternion, wanted.quaternion)
            velocity = np.concatenate([velocity, turn / (held * action.angular_speed)])
        return np.clip(velocity, -1.0, 1.0).astype(np.float32)


class Replay:
    """Recorded actions, one after the other; when they are used up, none. A file may say for how many steps each is
    meant to be held, as `hold`."""

    def __init__(self, path: Path, dimensions: int, action_repeat: int) -> None:
        try:
            with np.load(path, allow_pickle=False) as stored:
                actions = stored["actions"]
                hold = int(stored["hold"]) if "hold" in stored else action_repeat
        except (OSError, ValueError, KeyError) as error:
            raise ConfigError(f"{path}: cannot be read as a .npz file with an array `actions`: {error}") from error
        if actions.ndim != 2 or actions.shape[1] != dimensions:
            raise ConfigError(f"{path}: actions have shape {actions.shape}; accepted: (n, {dimensions})")
        if hold % action_repeat:
            raise ConfigError(f"{path}: each action is held for {hold} steps; the environment acts every "
                              f"{action_repeat}; accepted: an action_repeat that divides it")
        self._actions = iter(np.repeat(np.asarray(actions, np.float32), hold // action_repeat, axis=0))
        self._none = np.zeros(dimensions, np.float32)

    def __call__(self) -> np.ndarray:
        return next(self._actions, self._none)

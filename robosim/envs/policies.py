"""Policies that need no learning: do nothing, act at random, follow the task's script, replay recorded actions."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

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
        return Replay(Path(name), n)
    raise UnknownName("policy", name, NAMES, "or the path of a .npz file with an array `actions`")


class Script:
    """Follows the poses of the task's script: smooth in time between them."""

    def __init__(self, env: GrainEnv) -> None:
        self._env, self._task = env, env.task
        begin = env.carrier.commanded
        self._times = np.array([0.0] + [s.time for s in self._task.script])
        self._places = np.array([begin.position] + [np.array(s.position) for s in self._task.script])
        self._pitches = np.array([self._task.start.pitch_deg] + [s.pitch_deg for s in self._task.script])

    def __call__(self) -> np.ndarray:
        env, action = self._env, self._task.action
        now = env.carrier.commanded
        held = min(env.action_repeat, self._task.steps - env.step_count) * self._task.step_dt
        place, quaternion = self._pose(env.step_count * self._task.step_dt + held)
        velocity = (place - now.position) / (held * action.speed)
        if action.dimensions == 6:
            turn = now.matrix @ relative_rotation(now.quaternion, quaternion)
            velocity = np.concatenate([velocity, turn / (held * action.angular_speed)])
        return np.clip(velocity, -1.0, 1.0).astype(np.float32)

    def _pose(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Position and quaternion at a time [s]."""
        k = min(max(int(np.searchsorted(self._times, time)), 1), len(self._times) - 1)
        u = np.clip((time - self._times[k - 1]) / (self._times[k] - self._times[k - 1]), 0.0, 1.0)
        u = u * u * (3.0 - 2.0 * u)
        place = (1 - u) * self._places[k - 1] + u * self._places[k]
        pitch = (1 - u) * self._pitches[k - 1] + u * self._pitches[k]
        turn = Rotation.from_euler("ZY", (self._task.start.yaw_deg, pitch), degrees=True)
        return place, turn.as_quat(scalar_first=True)


class Replay:
    """Recorded actions, one after the other; when they are used up, none."""

    def __init__(self, path: Path, dimensions: int) -> None:
        try:
            with np.load(path, allow_pickle=False) as stored:
                actions = stored["actions"]
        except (OSError, ValueError, KeyError) as error:
            raise ConfigError(f"{path}: cannot be read as a .npz file with an array `actions`: {error}") from error
        if actions.ndim != 2 or actions.shape[1] != dimensions:
            raise ConfigError(f"{path}: actions have shape {actions.shape}; accepted: (n, {dimensions})")
        self._actions = iter(np.asarray(actions, np.float32))
        self._none = np.zeros(dimensions, np.float32)

    def __call__(self) -> np.ndarray:
        return next(self._actions, self._none)

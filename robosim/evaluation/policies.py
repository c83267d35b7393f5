"""What acts in an environment: nothing, chance, the task's script, recorded actions, a learned network."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar
from zipfile import BadZipFile

import numpy as np

from mpm.geometry.rigid_motion import relative_rotation
from robosim.config.resources import trained
from robosim.envs.grain_env import GrainEnv
from robosim.errors import ConfigError, UnknownName
from robosim.evaluation import POLICIES

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
    if name == "learned":
        shipped = trained(env.TASK)
        if shipped is None:
            raise ConfigError(f"policy 'learned': none ships for {env.TASK or 'a task of your own'}; `robosim train` "
                              f"learns one")
        return Replay(shipped, _stored(shipped), env)
    if Path(name).is_file():
        stored = _stored(Path(name))
        return Network(Path(name), stored, env) if "weight_0" in stored else Replay(Path(name), stored, env)
    raise UnknownName("policy", name, POLICIES, "or the path of a .npz file with an array `actions`, or with a network")


def learnt_with(name: str) -> dict[str, Any]:
    """Options of the environment that the network or the motion in a file was learnt in; none for any other policy."""
    if not Path(name).is_file():
        return {}
    stored = _stored(Path(name))
    kinds: dict[str, tuple[str, type]] = {"hold": ("action_repeat", int)}
    if "weight_0" in stored:
        kinds["obs"] = ("obs", str)
    return {option: kind(stored[key]) for key, (option, kind) in kinds.items() if key in stored}


def _stored(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a .npz file."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            return dict(stored)
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise ConfigError(f"{path}: cannot be read as a .npz file: {error}") from error


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

    def __init__(self, path: Path, stored: dict[str, np.ndarray], env: GrainEnv) -> None:
        if "actions" not in stored:
            raise ConfigError(f"{path}: holds {', '.join(stored)}; accepted: an array `actions`, or `weight_0`, "
                              f"`bias_0` and so on")
        dimensions, actions = env.task.action.dimensions, stored["actions"]
        hold = int(stored.get("hold", env.action_repeat))
        if actions.ndim != 2 or actions.shape[1] != dimensions:
            raise ConfigError(f"{path}: actions have shape {actions.shape}; accepted: (n, {dimensions})")
        made_for = str(stored.get("task", env.TASK))
        if type(env).TASK and made_for != env.TASK:  # in a scene of their own people may try any motion
            raise ConfigError(f"{path}: actions for {made_for}; accepted: for {env.TASK}")
        if hold % env.action_repeat:
            raise ConfigError(f"{path}: each action is held for {hold} steps; the environment acts every "
                              f"{env.action_repeat}; accepted: an action_repeat that divides it")
        self._actions = iter(np.repeat(np.asarray(actions, np.float32), hold // env.action_repeat, axis=0))
        self._none = np.zeros(dimensions, np.float32)

    def __call__(self) -> np.ndarray:
        return next(self._actions, self._none)


class Network:
    """A learned policy: layers W x + b, each followed by what `activations` names, the last one kept within -1 and 1 as
    `bound` says; `obs` and `hold` are the environment's that it was learnt in."""

    FUNCTIONS: ClassVar[dict[str, Callable[[np.ndarray], np.ndarray]]] = {
        "none": lambda x: x, "relu": lambda x: np.maximum(x, 0.0), "tanh": np.tanh}

    def __init__(self, path: Path, stored: dict[str, np.ndarray], env: GrainEnv) -> None:
        names = [str(name) for name in stored.get("activations", [])]
        try:
            self._layers = [(stored[f"weight_{k}"], stored[f"bias_{k}"], self.FUNCTIONS[name])
                            for k, name in enumerate(names)]
            self._bounded = {"tanh": np.tanh, "clip": lambda x: np.clip(x, -1.0, 1.0)}[str(stored["bound"])]
        except KeyError as error:
            raise ConfigError(f"{path}: not a policy: {error} is missing or unknown") from error
        taken, given = self._layers[0][0].shape[1], env.observation_space.shape
        if given != (taken,) or self._layers[-1][0].shape[0] != env.task.action.dimensions:
            raise ConfigError(f"{path}: sees {taken} numbers, gives {self._layers[-1][0].shape[0]}; this environment "
                              f"shows {given} and takes {env.task.action.dimensions}; it was learnt with obs="
                              f"{stored.get('obs', '?')}, task {stored.get('task', '?')}")
        if int(stored.get("hold", env.action_repeat)) != env.action_repeat:
            raise ConfigError(f"{path}: learnt with action_repeat={stored['hold']}; the environment has "
                              f"{env.action_repeat}")
        self._env = env

    def __call__(self) -> np.ndarray:
        x = self._env.observation
        for W, b, function in self._layers:
            x = function(W @ x + b)
        return self._bounded(x).astype(np.float32)

"""Policies of an environment: none, random, scripted, a dosing controller, recorded actions, a learned network."""

import json
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, get_args

import numpy as np

import mpm
from mpm.array_files import StoredArrays, read_arrays
from mpm.files import quote
from robosim.base.errors import ConfigError
from robosim.base.input_files import differing_entries
from robosim.base.resources import trained
from robosim.dosing import CONTROLLERS
from robosim.envs.grain_env import GrainEnv
from robosim.senses.perception import Layout, observation_options
from robosim.senses.senses import valid_terms
from robosim.senses.term import SenseScene
from robosim.studies.policies import KNOWING, PULSED, check_policy
from robosim.studies.policies.dosing import DosingPolicy, PulsePolicy
from robosim.studies.policies.network import Network
from robosim.studies.policies.script import ScriptedPolicy
from robosim.tasks.actions import rest_action
from robosim.tasks.task import TaskConfig

Policy = Callable[[Any], np.ndarray]
"""Returns the next action (dimensions,) of the episode for an observation."""
LARGEST = 1e30
"""Largest number of an action, which the environment clips; single precision has numbers of up to 3e38."""
MAX_REPEAT = 10_000
"""Steps that an action of a file is repeated for: 20 s at steps of 2 ms, ten episodes."""


def make_policy(name: str, env: GrainEnv, seed: int) -> Policy:
    """Make the policy of one episode, by name or from a .npz file.
    A file holds the array `actions` (n, dimensions), or a network as `robosim train` exports it.
    Raises UnknownName for what is neither, ConfigError for a file that does not fit the environment."""
    n = env.task.action.size
    if name == "zero":
        still = rest_action(env.task)
        return lambda observation: still.copy()
    if name == "random":
        rng = np.random.default_rng(seed)
        return lambda observation: rng.uniform(-1.0, 1.0, n).astype(np.float32)
    if name in ("scripted", KNOWING):
        return ScriptedPolicy(env, knows=name == KNOWING)
    if name in CONTROLLERS:
        return DosingPolicy(name, env)
    if name == "recorded":
        bundled = bundled_motion(env.TASK)
        return ReplayPolicy(bundled, load_policy(bundled), env)
    check_policy(name)
    arrays = load_policy(Path(name))
    if "weight_0" not in arrays:
        return ReplayPolicy(Path(name), arrays, env)
    return (PulsePolicy if arrays.text("expert", "") == PULSED else NetworkPolicy)(Path(name), arrays, env)


def bundled_motion(task: str) -> Path:
    """Return the file of a task's bundled motion; raises ConfigError where there is none."""
    path = trained(task)
    if path is None:
        raise ConfigError(f"policy 'recorded': there is no bundled motion for {task or 'this task'}; `robosim train` "
                          f"learns one, give its .npz file")
    return path


def training_options(name: str) -> dict[str, Any]:
    """Return the environment's options that a policy file was learned with; none for a policy by name.
    Raises ConfigError for a file that cannot be read."""
    if not Path(name).is_file():
        return {}
    arrays, options = load_policy(Path(name)), {}
    if "action_repeat" in arrays:
        options["action_repeat"] = arrays.integer("action_repeat", None, 1, MAX_REPEAT)
    if "weight_0" in arrays and "obs" in arrays:
        options |= observation_options(arrays.text("obs", ""))
    return options


def load_policy(path: Path) -> StoredArrays:
    """Load the arrays of a policy's .npz file; raises ConfigError for one that cannot be read or used."""
    try:
        arrays = read_arrays(path)
        arrays.check_finite()
        arrays.integer("action_repeat", 1, 1, MAX_REPEAT)
        for name in ("task", "obs", "bound", "expert"):
            arrays.text(name, "")
    except (OSError, mpm.InvalidValue) as error:
        raise ConfigError(f"{error}") from None
    return arrays


def check_task(name: str, task: TaskConfig, changed: Collection[str] = (), arm: Any = None) -> None:
    """Raise ConfigError where a network's file was learned on another task, or on another version of it, or observes
    terms that the task's environment does not have. arm: None without one.
    changed: top-level keys of the task's file that were changed on purpose."""
    arrays = load_policy(Path(name)) if Path(name).is_file() else StoredArrays(Path(name), {})
    if "weight_0" not in arrays:
        return
    terms, nothing = arrays.text("obs", "flat").split(","), None
    valid = valid_terms(SenseScene(task, nothing, nothing, arm))  # pyright: ignore[reportArgumentType]
    lacking = [one for one in terms if one not in valid]
    if lacking and terms[0] not in get_args(Layout):
        raise ConfigError(f"policy {name}: observes {', '.join(terms)}; this environment has no {', '.join(lacking)}; "
                          f"it has {', '.join(valid)}")
    if "task_table" not in arrays:
        return
    try:
        learned = json.loads(arrays.text("task_table", ""))
    except ValueError as error:
        raise ConfigError(f"{name}: task_table: not JSON: {error}") from None
    now = json.loads(task.model_dump_json(exclude={"description"}))
    differing = {key: values for key, values in differing_entries(learned, now).items()
                 if key.split(".")[0] not in changed}
    if differing:
        texts = [f"{key} {quote(values[0])}, here {quote(values[1])}" for key, values in differing.items()]
        more = f" and {len(texts) - 3} more" if len(texts) > 3 else ""
        raise ConfigError(f"policy {name}: learned on {arrays.text('task', 'another task')} with "
                          f"{'; '.join(texts[:3])}{more}; accepted: the task that it was learned on")


class ReplayPolicy:
    """Recorded actions, one after the other, and zeros after the last.
    A file may state the steps that each action is meant for, as `action_repeat`; the environment's must divide it.
    Raises ConfigError for actions of another shape, task or action_repeat."""

    def __init__(self, path: Path, arrays: StoredArrays, env: GrainEnv) -> None:
        if "actions" not in arrays:
            raise ConfigError(f"{path}: holds {', '.join(arrays)}; accepted: an array `actions`, or `weight_0`, "
                              f"`bias_0` and so on")
        dimensions, actions = env.task.action.size, arrays.numbers("actions")
        steps = arrays.integer("action_repeat", env.action_repeat, 1, MAX_REPEAT)
        if actions.ndim != 2 or actions.shape[1] != dimensions or not np.all(np.abs(actions) <= LARGEST):
            raise ConfigError(f"{path}: actions of type {actions.dtype} have shape {actions.shape}; accepted: (n, "
                              f"{dimensions}), numbers of up to {LARGEST:g}")
        recorded_for = arrays.text("task", env.TASK)
        if type(env).TASK and recorded_for != env.TASK:  # a task file takes any motion that fits
            raise ConfigError(f"{path}: actions for {recorded_for}; accepted: for {env.TASK}")
        if steps % env.action_repeat:
            raise ConfigError(f"{path}: its actions are for {steps} steps each; the environment acts every "
                              f"{env.action_repeat}; accepted: an action_repeat that divides {steps}")
        self._actions = iter(np.repeat(np.asarray(actions, np.float32), steps // env.action_repeat, axis=0))
        self._zero = rest_action(env.task)

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the next action, whatever is observed."""
        return next(self._actions, self._zero)


class NetworkPolicy:
    """A learned network in the environment that it fits.
    With `residual` it corrects the `expert`, the script that knows, by at most that share of the action range. Raises
    ConfigError, mpm.InvalidValue for a network that does not fit."""

    def __init__(self, path: Path, arrays: StoredArrays, env: GrainEnv) -> None:
        self._network = network = Network(path, arrays)
        own = env.world.observer.names
        if network.obs not in ("", own):
            raise ConfigError(f"{path}: observes {network.obs}; this environment observes {own}")
        network.check_sizes(own, env.observation_space.shape, env.task.action.size)
        if arrays.integer("action_repeat", env.action_repeat, 1, MAX_REPEAT) != env.action_repeat:
            raise ConfigError(f"{path}: learned with action_repeat={arrays['action_repeat']}; the environment has "
                              f"{env.action_repeat}")
        self._expert: Policy | None = None
        if "expert" in arrays:
            if (expert := arrays.text("expert", "")) != KNOWING:
                raise ConfigError(f"{path}: corrects {expert!r}; accepted: {KNOWING}, {PULSED}")
            self._share, self._expert = arrays.numbers("residual").flat[0], ScriptedPolicy(env, knows=True)

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the action for an observation (inputs,)."""
        action = self._network(observation)
        if self._expert is not None:
            action = np.clip(self._expert(observation) + self._share * action, -1.0, 1.0).astype(np.float32)
        return action

"""Policies as files: recorded actions, or a learned network with the terms that it observes."""

import json
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, ClassVar, get_args

import numpy as np

import mpm
from mpm.array_files import StoredArrays, read_arrays
from mpm.files import quote
from robosim.base.errors import ConfigError
from robosim.base.input_files import differing_entries
from robosim.senses.perception import Layout
from robosim.senses.senses import valid_terms
from robosim.senses.term import SenseScene
from robosim.tasks.task import TaskConfig

MAX_REPEAT = 10_000
"""Steps that an action of a file is repeated for: 20 s at steps of 2 ms, ten episodes."""


def load_policy(path: Path) -> StoredArrays:
    """Load the arrays of a policy's .npz file; raises ConfigError for one that cannot be read or used."""
    try:
        stored = read_arrays(path)
        stored.check_finite()
        # until release 0.1 action_repeat was called hold
        arrays = StoredArrays(path, {"action_repeat" if key == "hold" else key: array for key, array in stored.items()})
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


class Network:
    """A learned network: layers W x + b, each followed by the function that `activations` names.

    `bound` names how the last layer is kept within -1 and 1; units of observations are part of the first layer. Raises
    ConfigError, mpm.InvalidValue for arrays that are no network."""

    FUNCTIONS: ClassVar[dict[str, Callable[[np.ndarray], np.ndarray]]] = {
        "none": lambda x: x, "relu": lambda x: np.maximum(x, 0.0), "tanh": np.tanh}

    def __init__(self, path: Path, arrays: StoredArrays) -> None:
        names = [str(name) for name in arrays.get("activations", np.zeros(0)).ravel()]
        try:
            self._layers = [(arrays[f"weight_{k}"], arrays[f"bias_{k}"], self.FUNCTIONS[name])
                            for k, name in enumerate(names)]
            self._bound = {"tanh": np.tanh, "clip": lambda x: np.clip(x, -1.0, 1.0)}[str(arrays["bound"])]
        except KeyError as error:
            raise ConfigError(f"{path}: not a policy: {error} is missing or unknown") from error
        self._path, self._inputs, self._outputs = path, *_check_chain(path, [(W, b) for W, b, _ in self._layers])
        self.obs, self._task = arrays.text("obs", ""), arrays.text("task", "?")

    def check_sizes(self, observed: str, shape: tuple[int, ...] | None, task: TaskConfig) -> None:
        """Raise ConfigError where it does not take observations of a shape, or gives no action of a task."""
        if shape != (self._inputs,) or self._outputs != task.action.size:
            raise ConfigError(f"{self._path}: takes {self._inputs} numbers and gives {self._outputs}; this environment "
                              f"observes {observed}, {shape}, and takes {task.action.size}; the network was learned "
                              f"for {self._task}")

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the action (outputs,) for an observation (inputs,)."""
        x = observation
        for W, b, function in self._layers:
            x = function(W @ x + b)
        return self._bound(x).astype(np.float32)


def _check_chain(path: Path, layers: list[tuple[np.ndarray, np.ndarray]]) -> tuple[int, int]:
    """Return the numbers of inputs and outputs of layers; raise ConfigError where one does not fit the one before."""
    width = layers[0][0].shape[-1] if layers and layers[0][0].ndim else 0
    inputs = width
    for k, (W, b) in enumerate(layers):
        if W.ndim != 2 or W.shape[1] != width or b.shape != W.shape[:1] or {W.dtype.kind, b.dtype.kind} != {"f"}:
            raise ConfigError(f"{path}: weight_{k} and bias_{k} have shapes {W.shape} and {b.shape}, types {W.dtype} "
                              f"and {b.dtype}; accepted: floating-point numbers of shapes (n, {width}) and (n,)")
        width = W.shape[0]
    if not layers:
        raise ConfigError(f"{path}: not a policy: no activations; accepted: one for each layer")
    return inputs, width

"""Learned networks as files hold them: layers of numbers, no code."""

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np

from mpm.array_files import StoredArrays
from robosim.base.errors import ConfigError


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

    def check_sizes(self, observed: str, shape: tuple[int, ...] | None, outputs: int) -> None:
        """Raise ConfigError where it does not take observations of a shape, or gives another number of outputs."""
        if shape != (self._inputs,) or self._outputs != outputs:
            raise ConfigError(f"{self._path}: takes {self._inputs} numbers and gives {self._outputs}; this environment "
                              f"observes {observed}, {shape}, and takes {outputs}; the network was learned for "
                              f"{self._task}")

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

"""Checks of arrays that a user gives."""

from collections.abc import Mapping

import numpy as np

from mpm.errors import InvalidValue


def check_finite(what: str, values: object, shape: tuple[int, ...]) -> np.ndarray:
    """Return a copy in double precision; raise InvalidValue for another shape, or numbers that are not finite."""
    array = np.array(values, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise InvalidValue(f"{what} = {values}; accepted: finite numbers, shape {shape}")
    return array


def read_array(state: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return one of a snapshot's arrays; raise InvalidValue for a snapshot of another scene."""
    if name not in state:
        raise InvalidValue(f"load: the state has {', '.join(state)}; the scene also needs {name}")
    array = np.asarray(state[name])
    if array.shape != shape:
        raise InvalidValue(f"load: {name} has shape {array.shape}; the scene has {shape}")
    return array

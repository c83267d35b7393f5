"""Checks of what a user gives, and copies of what is checked."""

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from mpm.errors import InvalidValue

T = TypeVar("T")


def describe(given: object) -> str:
    """Return a short name of what was given instead of what is accepted: a value, or the type of an object."""
    if isinstance(given, type):
        return f"{given.__name__} (a class)"
    return f"{given!r:.60}" if isinstance(given, str | int | float | complex | None) else f"a {type(given).__name__}"


def in_one_line(values: object) -> str:
    """Return the beginning of what an array prints as, for a message."""
    return " ".join(str(values).split())[:200]


def read_real(what: str, values: object, accepted: str) -> np.ndarray:
    """Return a copy in double precision; raise InvalidValue for what is not of real numbers."""
    try:
        array = np.asarray(values)
        if array.dtype.kind in "biuf":
            return array.astype(float)
        if array.dtype.kind == "O":
            return np.array(values, float)
    except (TypeError, ValueError):
        pass
    raise InvalidValue(f"{what} = {in_one_line(values)}; accepted: {accepted}")


def check_finite(what: str, values: object, shape: tuple[int, ...]) -> np.ndarray:
    """Return a copy in double precision; raise InvalidValue for another shape, or numbers that are not finite."""
    array = read_real(what, values, f"finite numbers, shape {shape}")
    if array.shape != shape or not np.isfinite(array).all():
        raise InvalidValue(f"{what} = {in_one_line(values)}; accepted: finite numbers, shape {shape}")
    return array


def read_array(state: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return one of a snapshot's arrays; raise InvalidValue for a snapshot of another scene."""
    if name not in state:
        raise InvalidValue(f"load: the state has {', '.join(state)}; the scene also needs {name}")
    array = np.asarray(state[name])
    if array.dtype.kind not in "biuf":
        raise InvalidValue(f"load: {name} is of type {array.dtype}; accepted: real numbers")
    if array.shape != shape:
        raise InvalidValue(f"load: {name} has shape {array.shape}; the scene has {shape}")
    return array


def with_values(checked: T, **values: Any) -> T:
    """Return a copy of a dataclass with other values, without its checks: resets do this often, and arrays are long."""
    other = object.__new__(type(checked))
    other.__dict__.update(checked.__dict__, **values)
    return other

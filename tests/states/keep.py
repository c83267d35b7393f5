"""What a case keeps of its states: hashes of named arrays, and numbers that give a difference its size."""

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

HASH = 12
"""Hexadecimal digits of a hash."""


class Keep:
    """Values by name. A name that is given again is a series: every value has a hash of its own."""

    def __init__(self) -> None:
        self.values: dict[str, dict[str, Any]] = {}

    def __call__(self, name: str, value: Any) -> None:
        """Keep an array, a number, a text, None, or what is made of them: mappings, tuples, lists, dataclasses."""
        parts = take_apart(value)
        if parts is not None:
            for key, part in parts.items():
                self(f"{name}/{key}", part)
            return
        array = as_array(value)
        kept = self.values.setdefault(name, {"hashes": [], "sum": 0.0, "most": 0.0})
        head = f"{array.dtype.str} {array.shape} ".encode()
        kept["hashes"].append(hashlib.sha256(head + array.tobytes()).hexdigest()[:HASH])
        if array.size and array.dtype.kind in "biuf":
            numbers = array.astype(float)
            with np.errstate(all="ignore"):
                kept["sum"] += float(numbers.sum())
                kept["most"] = max(kept["most"], float(np.abs(numbers).max()))


def take_apart(value: Any) -> dict[str, Any] | None:
    """Return the parts of a value by their names; None for one that is an array, or becomes one."""
    if isinstance(value, Mapping):
        return {str(key): part for key, part in value.items()}
    if hasattr(value, "_asdict"):
        return value._asdict()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, list | tuple):
        try:
            is_plain = np.asarray(value).dtype.kind in "biuf"
        except ValueError:  # rows of several lengths
            is_plain = False
        return None if is_plain else {str(place): part for place, part in enumerate(value)}
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        return {str(place): part for place, part in enumerate(value.tolist())}
    return None


def as_array(value: Any) -> np.ndarray:
    """Return what is hashed of a value that has no parts; raises TypeError for one that is no state."""
    if value is None or isinstance(value, str):
        return np.frombuffer(repr(value).encode(), np.uint8)
    array = np.ascontiguousarray(value)
    if array.dtype.kind not in "biufU":
        raise TypeError(f"{type(value).__name__} is no state")
    return array

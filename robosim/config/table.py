"""Tables of configuration files and their loading.
Errors name the file or setting, the key, the value and what is accepted."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pydantic
from pydantic import BaseModel, ConfigDict
from scipy.spatial.transform import Rotation

from mpm.errors import say_meant
from mpm.files import quote
from mpm.geometry.rigid_motion import Pose
from robosim.base.errors import ConfigError
from robosim.base.input_files import read_text
from robosim.base.resources import locate_paths
from robosim.config.bounds import Angle, Coordinate, Name, Text
from robosim.config.settings import Setting, parse_yaml, with_settings

Vector3 = tuple[Coordinate, Coordinate, Coordinate]
"""Along x, y and z."""
Kind = TypeVar("Kind", bound="Table")
SHOWN = 10
"""Errors of a file that are described; a list of 10 000 wrong values has as many."""


class Table(BaseModel):
    """A table of a configuration file: frozen, typed, checked once, before any work."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Table":
        self.check()
        return self

    def check(self) -> None:
        """Raise ValueError for keys that do not go together."""


class Placement(Table):
    """A pose in the world, or in another frame."""

    position: Vector3 = (0.0, 0.0, 0.0)
    """[m]"""
    rotation_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """Rotations about the frame's x, then y, then z axis [deg]."""

    @property
    def pose(self) -> Pose:
        """The pose itself."""
        turn = Rotation.from_euler("xyz", self.rotation_deg, degrees=True)
        return Pose(np.array(self.position), turn.as_quat(scalar_first=True))


class Quantity(Table):
    """A number with its unit and its source."""

    value: float
    """The number itself, in this unit."""
    unit: Name
    """The unit that the key's meaning has in brackets: kg/m^3, Pa, deg, ...; 1 where it has none."""
    source: Text
    """Literature, or "assumed: ..." with the reason."""


def read(path: Path) -> Any:
    """Read a YAML file; raises ConfigError for one that cannot be read, is too large, or gives a key twice."""
    try:
        return parse_yaml(read_text(path))
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {str(error).removeprefix(f'{path}: ')}") from None


def load(path: Path, kind: type[Kind], overrides: dict | None = None, settings: Sequence[Setting] = ()) -> Kind:
    """Read a YAML file into a configuration, with settings and then overrides of its top keys in place of its values.
    Paths in the file are relative to it, those in settings and overrides to the working directory. Raises ConfigError
    with file or setting, key, value and what is accepted."""
    data = locate_paths(read(path), path.parent)
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: holds {type(data).__name__}; accepted: a table of {', '.join(kind.model_fields)}")
    return validate(data, path, kind, overrides, settings)


def validate(data: dict[str, Any], path: Path, kind: type[Kind], overrides: dict | None = None,
             settings: Sequence[Setting] = ()) -> Kind:
    """Make a configuration of the content of a file; arguments and errors as of `load`."""
    values = with_settings(data, settings) | (overrides or {})
    try:
        return kind.model_validate(values)
    except pydantic.ValidationError as error:
        raise ConfigError(list_errors(error, values, lambda e: _located(e, kind, path, settings))) from None


def list_errors(error: pydantic.ValidationError, data: Any, line: Callable[[Any], str]) -> str:
    """Join the descriptions of errors in data, the first SHOWN of them.
    Pydantic's places name branches of unions between the keys, and a value that fits one branch has errors of all."""
    errors = []
    for one in list[Any](error.errors()):
        value, place = data, tuple[int | str, ...]()
        for part in one["loc"]:
            is_held = part in value if isinstance(value, dict) else (
                isinstance(value, list | tuple) and isinstance(part, int) and part < len(value))
            if is_held or isinstance(part, int) or (one["type"] == "missing" and part == one["loc"][-1]):
                place, value = (*place, part), value[part] if is_held else ()
        errors.append({**one, "loc": place})
    inner = {one["loc"][:n] for one in errors for n in range(len(one["loc"]) + (one["type"] == "value_error"))}
    texts = [line(one) for one in errors if one["loc"] not in inner or not one["type"].endswith(("_type", "too_short"))]
    more = f"; and {len(texts) - SHOWN} more" if len(texts) > SHOWN else ""
    return "; ".join(texts[:SHOWN]) + more


def describe(error: Any, kind: type[Any]) -> str:
    """Describe one of pydantic's errors: key, value, reason; of an unknown key the keys that exist."""
    place, table, meaning = ".".join(str(part) for part in error["loc"]), kind, ""
    for part in error["loc"]:
        meaning = getattr(table.model_fields.get(part), "description", meaning) or ""
        table = _child(table, part)
    if error["type"] == "extra_forbidden":
        meant = say_meant(error["loc"][-1], table.model_fields)
        return f"unknown key {place!r}; valid: {', '.join(table.model_fields)}{meant}"
    if error["type"] == "value_error":
        return f"{place}: {error['ctx']['error']}" if place else str(error["ctx"]["error"])
    value = "" if error["type"] == "missing" else f" (given: {quote(error['input'])})"
    if "[m]" in meaning and error["type"].startswith(("less_than", "greater_than")):
        given, (most, *_) = error["input"], error["ctx"].values()
        is_large = isinstance(given, int | float) and abs(most) < abs(given) < 1e6 and given * most > 0
        value += f"; it is in metres{f'; did you mean {given:g} mm, {given / 1e3:g}?' if is_large else ''}"
    return f"{place or 'file'}: {error['msg']}{value}"


def _located(error: Any, kind: type[Table], path: Path, settings: Sequence[Setting]) -> str:
    """Describe an error after the setting that it is about, or else after the file and all settings."""
    place, text = tuple(map(str, error["loc"])), describe(error, kind)
    for setting in settings:
        shared = min(len(place), len(setting.path))
        if shared and place[:shared] == setting.path[:shared]:
            return f"{setting.name}: {text.removeprefix('.'.join(setting.path) + ': ')}"
    return f"{' '.join([str(path), *(setting.name for setting in settings)])}: {text}"


def _child(table: Any, part: int | str) -> Any:
    """Find the table class of a key, also inside lists, unions and tables with free names."""
    if isinstance(part, int):
        return table
    field = table.model_fields.get(part)
    pending = [field.annotation] if field else []
    while pending:
        candidate = pending.pop()
        if isinstance(candidate, type) and issubclass(candidate, pydantic.BaseModel):
            return candidate
        pending.extend(getattr(candidate, "__args__", ()))
    return table

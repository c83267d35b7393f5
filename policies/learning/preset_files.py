"""Files of methods and sweeps: reading, with errors that name the key; migration of what earlier versions wrote."""

import copy
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

import pydantic
import yaml

import mpm
from mpm.files import quote
from policies.learning.bundled import check_method
from policies.learning.presets import OFF_POLICY, Preset
from robosim.base.input_files import StrictComposer, read_text

Model = TypeVar("Model", bound=pydantic.BaseModel)
Change = Callable[[dict[str, Any]], dict[str, Any]]
"""Returns a changed copy of a table."""
MANIFEST_KEYS = {"hold": "action_repeat"}
ROW_KEYS = {"hold": "action_repeat", "wanted": "max_episodes", "best": "tcs_of_best_return", "tcs": "tcs_last10"}
"""Old key -> new key."""
SHOWN = 10
"""Errors of a file that are described."""


def change_keys(table: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of a table with values for dotted keys; raises mpm.InvalidValue for a key below one that has none.
    """
    changed = copy.deepcopy(table)
    for key, value in changes.items():
        *parents, last = key.split(".")
        place = changed
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise mpm.InvalidValue(f"set: {key}: {parent} is {quote(place)}; accepted: a key of a table")
        place[last] = value
    return changed


def load_preset(name: str, change: Change | None = None) -> Preset:
    """Load a method by name, or from a .yaml file.

    change: of the file's table, before it is checked.

    Raises:
        mpm.InvalidValue: the method is unknown, or its file is wrong.
    """
    return load_model(check_method(name), Preset, change)


def load_model(path: Path, kind: type[Model], change: Change | None = None) -> Model:
    """Load a .yaml file as a pydantic model.

    change: of the file's table, before it is checked. A model's `RENAMED`, keys of earlier versions -> their names now,
    is used in errors.

    Raises:
        mpm.InvalidValue: the file cannot be read or does not fit the model.
    """
    table = read_yaml(path)
    if not isinstance(table, dict):
        raise mpm.InvalidValue(f"{path}: holds {quote(table)}; accepted: a table of {', '.join(kind.model_fields)}")
    return validate(change(table) if change else table, path, kind)


def validate(table: dict[str, Any], path: Path, kind: type[Model]) -> Model:
    """Make a model of the content of a file; raises mpm.InvalidValue for what does not fit it."""
    try:
        return kind.model_validate(table)
    except pydantic.ValidationError as error:
        raise mpm.InvalidValue(f"{path}: {describe_error(error, kind)}") from None


class _Loader(StrictComposer, yaml.SafeLoader):
    """Reads YAML within bounds, without duplicate keys."""


def read_yaml(path: Path) -> Any:
    """Read a YAML file; raises mpm.InvalidValue for one that cannot be read, is too large, or gives a key twice."""
    try:
        return yaml.load(read_text(path), _Loader)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise mpm.InvalidValue(f"{path}: cannot be read as YAML: {str(error).removeprefix(f'{path}: ')}") from None


def describe_error(error: pydantic.ValidationError, kind: type[pydantic.BaseModel]) -> str:
    """Return what is wrong with a file, in one line: key, reason, value; for an unknown key, those that exist."""
    texts = [_describe_item(item, kind) for item in error.errors()]
    return "; ".join(texts[:SHOWN]) + (f"; and {len(texts) - SHOWN} more" if len(texts) > SHOWN else "")


def _describe_item(item: Any, kind: type[pydantic.BaseModel]) -> str:
    key = ".".join(map(str, item["loc"]))
    if item["type"] == "extra_forbidden":
        table = model_at(kind, item["loc"][:-1])
        renamed = getattr(table, "RENAMED", {}).get(item["loc"][-1])
        return f"key {key!r} is now called {renamed!r}; rename it" if renamed else \
            f"unknown key {key!r}; accepted: {', '.join(table.model_fields)}"
    given = f" (given: {quote(item['input'])})" if item["type"] not in ("missing", "value_error") else ""
    return f"{key or 'file'}: {item['msg'].removeprefix('Value error, ')}{given}"


def model_at(kind: type[pydantic.BaseModel], keys: Sequence[int | str]) -> type[pydantic.BaseModel]:
    """Return the model of a table within another; each key holds a table or null, or is a place in a list of tables."""
    for key in keys:
        if isinstance(key, int):
            continue
        pending: list[Any] = [kind.model_fields[key].annotation]
        for one in pending:  # grows while it is read
            pending += get_args(one)
        kind = next(one for one in pending if isinstance(one, type) and issubclass(one, pydantic.BaseModel))
    return kind


def migrate_preset(preset: dict[str, Any]) -> dict[str, Any]:
    """Return a stored preset with defaults for missing keys and without settings that had no effect.

    A dictionary that is no preset is returned unchanged.
    """
    has_no_effect = preset.get("residual") is not None or preset.get("learner") not in OFF_POLICY
    try:
        return Preset(**{**preset, **({"demonstrations": None} if has_no_effect else {})}).model_dump()
    except pydantic.ValidationError:
        return preset


def migrate_manifest(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return the manifest of a run folder with today's keys and a migrated preset."""
    renamed = {"n_envs": 1, **_rename_keys(manifest, MANIFEST_KEYS)}
    return {**renamed, "preset": migrate_preset(renamed["preset"])} if isinstance(renamed.get("preset"), dict) \
        else renamed


def migrate_row(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of tables.json with today's keys."""
    return _rename_keys(row, ROW_KEYS)


def _rename_keys(values: dict[str, Any], names: dict[str, str]) -> dict[str, Any]:
    return {names.get(key, key): value for key, value in values.items()}

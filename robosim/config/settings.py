"""Settings `key=value` from the command line, applied to a configuration before it is checked."""

import copy
import json
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

from mpm.files import show
from robosim.base.errors import ConfigError

MAX_KEYS = 20
"""Keys of a setting's path: as deep as files are read."""


class Setting(NamedTuple):
    """A value for a key of a configuration: `--set waypoints.2.speed=0.1`."""

    path: tuple[str, ...]
    """Keys from the file's top down, and places (from 0) in lists."""
    value: object

    @property
    def name(self) -> str:
        """The option as it was given, without its value."""
        return f"--set {'.'.join(self.path)}"

    @property
    def text(self) -> str:
        """KEY=VALUE, which `read_setting` reads as the same setting."""
        return f"{'.'.join(self.path)}={json.dumps(self.value, default=str)}"


def read_setting(text: str) -> Setting:
    """Read KEY=VALUE, the value as YAML; raises ConfigError for anything else."""
    key, equals, value = text.partition("=")
    path = tuple(key.strip().split("."))
    if not equals or not all(path) or len(path) > MAX_KEYS:
        raise ConfigError(f"--set {show(text)}; accepted: KEY=VALUE with a dotted key, such as field.cell=0.005")
    if re.fullmatch(r"\s*[-+]?\d+(\.\d*)?[eE][-+]?\d+\s*", value):  # YAML 1.1 takes 3e-4 for a text
        return Setting(path, float(value))
    try:
        return Setting(path, parse_yaml(value))
    except ValueError as error:
        raise ConfigError(f"--set {show(text)}: the value cannot be read as YAML: {error}") from None


def parse_yaml(text: str) -> Any:
    """Parse YAML; raises mpm.InvalidValue, with the line, for what is none, duplicate keys, or deep nesting."""
    import yaml  # here, so that `--help` does without

    from mpm.errors import InvalidValue
    from robosim.base.input_files import StrictComposer

    class Loader(StrictComposer, yaml.SafeLoader):
        pass

    try:
        return yaml.load(text, Loader)
    except yaml.YAMLError as error:
        raise InvalidValue(" ".join(str(error).split())) from None


def with_settings(table: dict[str, Any], settings: Iterable[Setting]) -> dict[str, Any]:
    """Copy a table with the settings applied; raises ConfigError for a place in a list that does not exist.
    Whether a key exists is for the schema to say: a key that is missing may have a default."""
    changed = copy.deepcopy(table)
    for setting in settings:
        node: Any = changed
        for depth, key in enumerate(setting.path):
            here = ".".join(setting.path[:depth]) or "the file"
            is_last = depth == len(setting.path) - 1
            if isinstance(node, list):
                if not key.isdecimal() or int(key) >= len(node):
                    raise ConfigError(f"{setting.name}: {here} is a list, {key!r} is no place in it; accepted: "
                                      f"0 to {len(node) - 1}")
                place: Any = int(key)
            elif isinstance(node, dict):
                place = key
                if not is_last and node.get(key) is None:
                    node[key] = {}
            else:
                raise ConfigError(f"{setting.name}: {here} is {node!r}, neither a table nor a list; accepted: "
                                  f"--set {here}=VALUE")
            if is_last:
                node[place] = setting.value
            else:
                node = node[place]
    return changed

"""Files that others wrote: text, JSON and YAML, read within bounds on size and nesting.
What a file says about itself (lengths, shapes, references) is compared with what is there before memory is taken."""

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mpm.errors import InvalidValue
from mpm.files import quote
from robosim.base.errors import ConfigError

MAX_TEXT = 256 * 1024
"""Bytes of a configuration file: 40 times the largest bundled one. YAML is read at about 0.1 MB/s."""
MAX_JSON = 64 * 2**20
"""Bytes of a JSON file: results of 100 000 episodes. Python needs ten times as much memory for them."""
MAX_DEPTH = 20
"""Tables and lists within one another; a configuration has five at most, and readers of files recurse."""
MAX_VALUES = 20_000
"""Values of a YAML file, those that aliases repeat counted each time: nine aliases of nine aliases ... are billions."""
MAX_NUMBER = 1e100
"""Size of a number of a JSON file: sums of squares of a million of them are finite."""
FORMS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false", list: "a list",
         dict: "a table"}


def read_bytes(path: Path, most: int) -> bytes:
    """Read a file of at most `most` bytes. Raises InvalidValue for a larger one, OSError where it cannot be read."""
    if path.exists() and not path.is_file():  # a pipe or a device may never end
        raise InvalidValue(f"{path}: not a file")
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise InvalidValue(f"{path}: has {path.stat().st_size} bytes; accepted: up to {most}")
    return content


def read_text(path: Path, most: int = MAX_TEXT) -> str:
    """Read a text file in UTF-8. Raises InvalidValue for another encoding or size, OSError as `read_bytes`."""
    try:
        return read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidValue(f"{path}: byte {error.start} is not UTF-8; accepted: text in UTF-8") from None


def read_rows(path: Path, most: int, place: object) -> list[list[str]]:
    """Read the rows of a .csv file, names first. place: for messages. Raises ConfigError where it cannot be read."""
    try:
        rows = csv.reader(io.StringIO(read_text(path, most), newline=""), skipinitialspace=True, strict=True)
        return [[cell.strip() for cell in row] for row in rows] or [[]]
    except (OSError, InvalidValue, csv.Error) as error:
        raise ConfigError(f"{place}: cannot be read: {str(error).removeprefix(f'{path}: ')}") from None


def to_numbers(rows: list[list[str]], names: Sequence[str], place: object, may_miss: str = "") -> np.ndarray:
    """Return the numbers (n, names) of columns of `read_rows`; empty rows are left out, place: for messages.
    may_miss: a column with empty cells, which are NaN. Raises ConfigError where a column or a number is missing."""
    head, values = rows[0], []
    for name in names:
        if name not in head:
            raise ConfigError(f"{place}: no column {name} among {', '.join(head)[:200]}; accepted: a file with "
                              f"{', '.join(names)}, named in the first line")
    places = [(name, head.index(name)) for name in names]
    for number, row in enumerate(rows[1:], 2):
        for name, k in places if any(row) else ():
            cell = row[k] if k < len(row) else ""
            try:
                values.append(float(cell) if cell or name != may_miss else math.nan)
            except ValueError:
                raise ConfigError(f"{place}: line {number}: {name} = {quote(cell)}; accepted: a number") from None
    return np.array(values).reshape(-1, len(names))


def read_json(path: Path) -> Any:
    """Read a JSON file. Raises InvalidValue for what is not JSON, OSError where it cannot be read."""
    try:
        return json.loads(read_text(path, MAX_JSON), parse_constant=_refuse_constant, parse_float=_finite,
                          object_pairs_hook=_unique)
    except RecursionError:
        raise InvalidValue(f"{path}: not JSON that can be read: lists or tables nested too deeply") from None
    except ValueError as error:
        text = str(error)
        raise InvalidValue(text if text.startswith(str(path)) else f"{path}: not JSON: {text}") from None


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not part of JSON")


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(f"{quote(text)} is too large")
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"key {quote(next(n for n in names if names.count(n) > 1))} is given twice")
    return table


def check_form(value: Any, form: Any, name: str = "file") -> None:
    """Raise InvalidValue unless a value of a JSON file has a form.
    form: float, int, str, bool or object (anything); [form] of a list; {key: form} of a table that has at least these
    keys, {str: form} of one with any keys; (form, None) of what may be null, (form, ...) of what may be missing."""
    if isinstance(form, tuple):
        if value is not None or None not in form:
            check_form(value, form[0], name)
    elif isinstance(form, dict) and isinstance(value, dict):
        for key, part in form.items():
            if key is not str and (key in value or not (isinstance(part, tuple) and ... in part)):
                if key not in value:
                    raise InvalidValue(f"{name}: key {key!r} is missing")
                check_form(value[key], part, f"{name}.{key}")
        for key, part in value.items() if str in form else ():
            check_form(part, form[str], f"{name}.{quote(key)}")
    elif isinstance(form, list) and isinstance(value, list):
        for k, part in enumerate(value):
            check_form(part, form[0], f"{name}.{k}")
    elif form is not object and not _has_type(value, form):
        raise InvalidValue(f"{name}: {quote(value)}; accepted: {FORMS[form if isinstance(form, type) else type(form)]}")


def differing_entries(one: Any, other: Any, place: str = "") -> dict[str, tuple[Any, Any]]:
    """Return the dotted keys in which two tables of JSON differ, with both values; None stands for a missing one."""
    if isinstance(one, dict) and isinstance(other, dict):
        return {key: values for name in {**one, **other} for key, values in
                differing_entries(one.get(name), other.get(name), f"{place}.{name}".strip(".")).items()}
    return {} if one == other else {place: (one, other)}


def _has_type(value: Any, kind: Any) -> bool:
    """Return whether a value has a type of JSON; numbers whose squares a float does not hold have none."""
    if kind in (int, float):
        is_number = isinstance(value, int if kind is int else int | float) and not isinstance(value, bool)
        return is_number and abs(value) <= MAX_NUMBER
    return kind in (str, bool) and isinstance(value, kind)


class StrictComposer:
    """To be put in front of a loader of PyYAML: refuses duplicate keys, deep nesting, and aliases that multiply.
    Raises InvalidValue, with the line."""

    _depth = _count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node as the loader does, and check it."""
        sizes = self.__dict__.setdefault("_sizes", {})
        is_alias = type(self.peek_event()).__name__ == "AliasEvent"  # pyright: ignore[reportAttributeAccessIssue]
        self._depth, self._count = self._depth + 1, self._count + 1
        if self._depth > MAX_DEPTH:
            raise InvalidValue(f"line {self._line()}: tables or lists nested more than {MAX_DEPTH} deep")
        node = super().compose_node(parent, index)  # pyright: ignore[reportAttributeAccessIssue]
        self._depth -= 1
        if is_alias and id(node) not in sizes:
            raise InvalidValue(f"line {self._line()}: an alias within what it stands for")
        if not is_alias:
            sizes[id(node)] = self._measure(node, sizes)
        if max(sizes[id(node)], self._count) > MAX_VALUES:
            raise InvalidValue(f"line {self._line()}: more than {MAX_VALUES} values, those that aliases repeat counted "
                               f"each time")
        return node

    def construct_document(self, node: Any) -> Any:
        """Construct the values as the loader does; its own failures, as for `!!int x`, become InvalidValue."""
        try:
            return super().construct_document(node)  # pyright: ignore[reportAttributeAccessIssue]
        except (ValueError, ArithmeticError, AttributeError, LookupError, TypeError, RecursionError) as error:
            raise InvalidValue(f"a value does not fit its type: {error}") from None

    def _measure(self, node: Any, sizes: dict[int, int]) -> int:
        """Return the number of values of a node; refuse keys that are given twice."""
        if isinstance(node.value, str):
            return 1
        is_table = bool(node.value) and isinstance(node.value[0], tuple)
        keys = [(key.tag, key.value, key.start_mark.line) for key, _ in node.value
                if isinstance(key.value, str)] if is_table else []
        seen = set()
        for tag, text, line in keys:
            if (tag, text) in seen:
                raise InvalidValue(f"line {line + 1}: key {quote(text)} is given twice; keep one of them")
            seen.add((tag, text))
        children = [child for pair in node.value for child in pair] if is_table else node.value
        return 1 + sum(sizes[id(child)] for child in children)

    def _line(self) -> int:
        return self.line + 1  # pyright: ignore[reportAttributeAccessIssue]



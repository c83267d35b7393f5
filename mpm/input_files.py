"""Files that others wrote: text, JSON, YAML and arrays, read within bounds on size, nesting and memory.

What a file says about itself (lengths, shapes, references) is compared with what is there before memory is taken.
"""

import json
import math
import re
import reprlib
import struct
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from mpm.errors import InvalidValue

MAX_TEXT = 256 * 1024
"""Bytes of a configuration file: 40 times the largest bundled one. YAML is read at about 0.1 MB/s."""
MAX_JSON = 64 * 2**20
"""Bytes of a JSON file: results of 100 000 episodes. Python needs ten times as much memory for them."""
MAX_ARRAYS = 64 * 2**20
"""Bytes of the arrays of a motion or a policy: a network of 2000 x 2000 units has 32 MB."""
MAX_STATE = 2**30
"""Bytes of the arrays of a state or of a rollout: 10 million grains, or 100 frames of 800 000."""
MAX_DEPTH = 20
"""Tables and lists within one another; a configuration has five at most, and readers of files recurse."""
MAX_VALUES = 20_000
"""Values of a YAML file, those that aliases repeat counted each time: nine aliases of nine aliases ... are billions."""
MAX_MEMBERS = 1000
"""Arrays of a file; a state has about 20."""
HEADER = re.compile(rb"\{'descr': '([<>|=]?[biufUS]\d{1,9})', 'fortran_order': (True|False), "
                    rb"'shape': \(((?:\d{1,19}, ?)*(?:\d{1,19})?)\), *\} *\n")
"""Header of an array of truth values, numbers or text, as numpy writes it; no objects, which would execute code."""
MAX_HEADER = 1000
"""Bytes of a header; those of numpy have 118."""
MAX_NUMBER = 1e100
"""Size of a number of a JSON file: sums of squares of a million of them are finite."""
FORMS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false", list: "a list",
         dict: "a table"}
BROKEN = (OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError, OverflowError,
          zipfile.BadZipFile, zlib.error, struct.error)
"""What numpy and zipfile raise for damaged files; RuntimeError: for encrypted ones, among others."""


def quote(value: object) -> str:
    """Return a value as messages show it: shortened, and without a failure for integers of thousands of digits."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = 200
    short.maxlist = short.maxtuple = short.maxdict = 12
    try:
        return short.repr(value)
    except ValueError:  # Python refuses to write integers of more than 4300 digits
        return f"a value of type {type(value).__name__} that is too long to show"


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


def read_json(path: Path, most: int = MAX_JSON) -> Any:
    """Read a JSON file. Raises InvalidValue for what is not JSON, OSError where it cannot be read."""
    try:
        return json.loads(read_text(path, most), parse_constant=_refuse_constant, parse_float=_finite,
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
    keys, {str: form} of one with any keys; (form, None) of what may be null, (form, ...) of what may be missing.
    """
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

    Raises InvalidValue, with the line.
    """

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


class StoredArrays(dict[str, np.ndarray]):
    """The arrays of a .npz file by name, with checked access to those that are single values."""

    def __init__(self, path: Path, arrays: Mapping[str, np.ndarray]) -> None:
        super().__init__(arrays)
        self.path = path

    def integer(self, name: str, default: int | None, least: int, most: int) -> int:
        """Return a whole number of the file; raises InvalidValue outside its bounds, or where there is no default."""
        if name not in self and default is not None:
            return default
        value = self.get(name)
        if value is None or value.size != 1 or value.dtype.kind not in "biuf" or not least <= value.item() <= most \
                or value.item() != int(value.item()):
            given = "missing" if value is None else f"{quote(value.tolist())}" if value.size < 10 else \
                f"an array of shape {value.shape}"
            raise InvalidValue(f"{self.path}: {name}: {given}; accepted: a whole number from {least} to {most}")
        return int(value.item())

    def text(self, name: str, default: str) -> str:
        """Return a text of the file; raises InvalidValue for another kind of array."""
        if name not in self:
            return default
        if self[name].size != 1 or self[name].dtype.kind not in "US":
            raise InvalidValue(f"{self.path}: {name}: an array of shape {self[name].shape} and type "
                               f"{self[name].dtype}; accepted: a text")
        return str(self[name].item())

    def numbers(self, name: str) -> np.ndarray:
        """Return an array of the file; raises InvalidValue where it is missing or holds anything but finite numbers."""
        if name not in self:
            raise InvalidValue(f"{self.path}: holds {', '.join(self) or 'no array'}; accepted: an array `{name}`")
        array = self[name]
        if array.dtype.kind not in "iuf":
            raise InvalidValue(f"{self.path}: {name}: of type {array.dtype}; accepted: real numbers")
        if not np.isfinite(array).all():
            raise InvalidValue(f"{self.path}: {name}: holds numbers that are not finite")
        return array

    def check_finite(self) -> None:
        """Raise InvalidValue where a number is not finite; texts and truth values may stand beside numbers."""
        for name, array in self.items():
            if array.dtype.kind == "f":
                self.numbers(name)


def read_arrays(path: Path, most: int = MAX_ARRAYS, names: Iterable[str] | None = None) -> StoredArrays:
    """Read the arrays of a .npz file, or those of the names given that it has.

    Raises InvalidValue for a file that is damaged, whose arrays take more than `most` bytes, or whose headers promise
    other sizes than the file has; OSError where it cannot be opened.
    """
    size = path.stat().st_size  # raises OSError where there is no file
    if not path.is_file() or size > most:
        raise InvalidValue(f"{path}: has {size} bytes; accepted: a .npz file of up to {most}")
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            _check_members(members, most)
            wanted = None if names is None else set(names)
            return StoredArrays(path, {
                member.filename.removesuffix(".npy"): _read_array(archive, member) for member in members
                if wanted is None or member.filename.removesuffix(".npy") in wanted})
    except BROKEN as error:
        reason = str(error) or type(error).__name__
        raise InvalidValue(f"{path}: cannot be read as a .npz file: {reason}") from None


def _check_members(members: list[zipfile.ZipInfo], most: int) -> None:
    """Refuse what the archive's directory says, before anything is unpacked."""
    if len(members) > MAX_MEMBERS:
        raise ValueError(f"{len(members)} arrays; accepted: up to {MAX_MEMBERS}")
    total = sum(member.file_size for member in members)
    if total > most:
        raise ValueError(f"its arrays take {total} bytes; accepted: up to {most}")
    for member in members:
        if not member.filename.endswith(".npy") or member.compress_type not in (zipfile.ZIP_STORED,
                                                                                 zipfile.ZIP_DEFLATED):
            raise ValueError(f"{quote(member.filename)} is no array as numpy.savez and savez_compressed write it")


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """Read one array; its header must promise what the member holds, which the archive's directory bounds."""
    name = member.filename.removesuffix(".npy")
    with archive.open(member) as file:
        try:
            shape, fortran_order, dtype = _read_header(file)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{quote(name)}: {error}") from None
        count = math.prod(shape)
        if dtype.itemsize == 0 or len(shape) > 8 or count * dtype.itemsize != member.file_size - file.tell():
            raise ValueError(f"the header of {name} promises shape {quote(shape)} of {dtype}, {count * dtype.itemsize} "
                             f"bytes; the file has {member.file_size - file.tell()}")
        content, filled = bytearray(count * dtype.itemsize), 0
        while chunk := file.read(2**20):  # all at once would take the memory twice
            content[filled : filled + len(chunk)] = chunk
            filled += len(chunk)
            if filled > count * dtype.itemsize:
                break
        if filled != count * dtype.itemsize:
            raise ValueError(f"{name} is shorter or longer than its header promises")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran_order else "C")


def _read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Read shape, whether columns are contiguous, and type. The text is matched; numpy evaluates it."""
    version = npy.read_magic(file)
    size = {(1, 0): 2, (2, 0): 4}.get(version, 0)
    length = int.from_bytes(file.read(size), "little")
    match = HEADER.fullmatch(file.read(length)) if 0 < length <= MAX_HEADER else None
    if match is None:
        raise ValueError(f"a header of {length} bytes, version {version}, is none of numpy's for numbers or text")
    descr, order, shape = (part.decode() for part in match.groups())
    return tuple(int(n) for n in shape.replace(",", " ").split()), order == "True", np.dtype(descr)

"""Files of arrays, read within bounds on size and memory.
What a file says about itself (lengths, shapes) is compared with what is there before memory is taken."""

import math
import re
import struct
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from mpm.errors import InvalidValue
from mpm.files import quote

MAX_ARRAYS = 64 * 2**20
"""Bytes of the arrays of a motion or a policy: a network of 2000 x 2000 units has 32 MB."""
MAX_STATE = 2**30
"""Bytes of the arrays of a state or of a rollout: 10 million grains, or 100 frames of 800 000."""
MAX_MEMBERS = 1000  # arrays of a file; a state has about 20
HEADER = re.compile(rb"\{'descr': '([<>|=]?[biufUS]\d{1,9})', 'fortran_order': (True|False), "
                    rb"'shape': \(((?:\d{1,19}, ?)*(?:\d{1,19})?)\), *\} *\n")
"""Header of an array of truth values, numbers or text, as numpy writes it; no objects, which would execute code."""
MAX_HEADER = 1000  # bytes of a header; those of numpy have 118
BROKEN = (OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError, OverflowError,
          zipfile.BadZipFile, zlib.error, struct.error)
"""What numpy and zipfile raise for damaged files; RuntimeError: for encrypted ones, among others."""


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
    other sizes than the file has; OSError where it cannot be opened."""
    size = path.stat().st_size  # raises OSError where there is no file
    if not path.is_file() or size > most:
        raise InvalidValue(f"{path}: has {size} bytes; accepted: a .npz file of up to {most}")
    with path.open("rb") as file:
        return parse_arrays(file, path, most, names)


def parse_arrays(file: IO[bytes], path: Path, most: int = MAX_ARRAYS,
                 names: Iterable[str] | None = None) -> StoredArrays:
    """Read arrays as `read_arrays` does from an open file, which messages call `path`."""
    try:
        with zipfile.ZipFile(file) as archive:
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
    names = [member.filename for member in members]
    if len(set(names)) < len(names):
        raise ValueError(f"{quote(next(name for name in names if names.count(name) > 1))} is in it twice")
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

"""Atomic writes and folder locks: what lies under a file's name is always complete, in folders of one process."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

import mpm

LOCK_NAME = ".lock"


def digest(value: Any) -> str:
    """Return twelve hexadecimal digits of the SHA-256 of a value's JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:12]


def lock_folder(folder: Path) -> FileLock:
    """Make a folder and lock it against other processes until the lock is released or this process ends.

    Raises:
        mpm.InvalidValue: another process holds the lock, or the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK_NAME)
        lock.acquire(timeout=0)
    except OSError as error:
        if not isinstance(error, Timeout):
            raise mpm.InvalidValue(f"--out {folder}: cannot be written: {error}; give another folder") from error
        raise mpm.InvalidValue(f"--out {folder}: another process is at work there; wait for it, or give another folder"
                               ) from None
    return lock


def is_locked(folder: Path) -> bool:
    """Return whether another process holds a folder's lock."""
    if not folder.is_dir():
        return False
    try:
        with FileLock(folder / LOCK_NAME).acquire(timeout=0):
            return False
    except Timeout:
        return True


def write(path: Path, writer: Callable[[Path], object]) -> None:
    """Call `writer` with a temporary path in the same folder, then rename that file to `path`."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        writer(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, value: object) -> None:
    """Write indented JSON. Raises ValueError for numbers that JSON does not have (NaN, infinity)."""
    text = json.dumps(value, indent=2, allow_nan=False) + "\n"
    write(path, lambda temporary: temporary.write_text(text))

"""Files written beside their place and renamed, so that what is there is always whole, in folders of one process."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

import mpm


def digest(value: Any) -> str:
    """Twelve letters that change with a value."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:12]


def claim(folder: Path) -> FileLock:
    """Make a folder and keep other processes out until the lock is released, or this process ends, however it ends;
    raises mpm.InvalidValue where one is at work there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / ".lock")
        lock.acquire(timeout=0)
    except OSError as error:
        if not isinstance(error, Timeout):
            raise mpm.InvalidValue(f"--out {folder}: cannot be written: {error}; give another folder") from error
        raise mpm.InvalidValue(f"--out {folder}: another process is at work there; wait for it, or give another folder"
                               ) from None
    return lock


def write(path: Path, writer: Callable[[Path], object]) -> None:
    """Let `writer` write a file beside `path`, then rename it."""
    beside = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        writer(beside)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def write_json(path: Path, value: object) -> None:
    """Indented JSON; refuses numbers that JSON does not know."""
    text = json.dumps(value, indent=2, allow_nan=False) + "\n"
    write(path, lambda place: place.write_text(text))

"""Folders that several processes work in: atomic writes, locks, and pools of workers that end with their parent.

What lies under a file's name is always complete.
"""

import ctypes
import hashlib
import json
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

import mpm

LOCK_NAME = ".lock"
PR_SET_PDEATHSIG = 1
"""Option of prctl(2): the signal that a process gets when its parent dies."""


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


def make_pool(jobs: int) -> ProcessPoolExecutor:
    """Return a pool of `jobs` processes, spawned because a forked one could not use a GPU."""
    return ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=end_with_parent,
                               initargs=(os.getpid(),))


def end_with_parent(parent: int) -> None:
    """Have the kernel kill this process when its parent dies (Linux only).

    Otherwise the workers of a killed command would go on writing to a folder whose lock is free.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # the parent died before the call above
            raise SystemExit(1)

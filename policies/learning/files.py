"""Folders that several processes work in: locks, and pools of workers that end with their parent."""

import contextlib
import ctypes
import hashlib
import json
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

import mpm
from robosim.base.files import keep_status, remove_temporary

LOCK_NAME = ".lock"
LOG_END = 2**16
"""Bytes at the end of a log in which its last line is looked for; progress bars make logs long."""
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
    remove_temporary(folder)
    return lock


@contextlib.contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Lock a folder as `lock_folder` does, and keep its status.json as `mpm.files.keep_status` does."""
    lock = lock_folder(folder)
    try:
        with keep_status(folder):
            yield
    finally:
        lock.release()


def is_locked(folder: Path) -> bool:
    """Return whether another process holds a folder's lock."""
    if not folder.is_dir():
        return False
    try:
        with FileLock(folder / LOCK_NAME).acquire(timeout=0):
            return False
    except Timeout:
        return True


def read_last_line(path: Path) -> str:
    """Return the last line of a log that is not empty, from its last LOG_END bytes; "" where there is none."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - LOG_END))
        lines = file.read(LOG_END).decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else ""


@contextlib.contextmanager
def worker_pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Give a pool of `jobs` processes, spawned because a forked one could not use a GPU.

    On an exception, such as Ctrl-C, the workers are stopped at once.
    """
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=start_worker,
                               initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        for process in active_children():  # or the pool would wait for the end of their work
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def start_worker(parent: int) -> None:
    """Leave Ctrl-C to the parent, and have the kernel kill this process when the parent dies (Linux only).

    Otherwise the workers of a killed command would go on writing to a folder whose lock is free.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # the parent died before the call above
            raise SystemExit(1)

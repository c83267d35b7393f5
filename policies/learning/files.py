"""Digests of values, ends of logs, and pools of workers that end with their parent."""

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context
from pathlib import Path

LOG_END = 2**16
"""Bytes at the end of a log in which its last line is looked for; progress bars make logs long."""
PR_SET_PDEATHSIG = 1
"""Option of prctl(2): the signal that a process gets when its parent dies."""


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

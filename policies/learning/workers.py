"""Pools of worker processes that end with the process that started them."""

import ctypes
import os
import signal
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

PR_SET_PDEATHSIG = 1
"""Option of prctl(2): the signal that a process gets when its parent dies."""


def make_pool(jobs: int) -> ProcessPoolExecutor:
    """Return a pool of `jobs` processes, spawned because Taichi does not survive a fork."""
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

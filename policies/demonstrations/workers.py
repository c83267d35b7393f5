"""Processes of one's own that work beside each other."""

import ctypes
import os
import signal
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

PR_SET_PDEATHSIG = 1


def pool(jobs: int) -> ProcessPoolExecutor:
    """So many processes, spawned (Taichi does not survive a fork), that end with this one, however it ends."""
    return ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=end_with, initargs=(os.getpid(),))


def end_with(parent: int) -> None:
    """Let this process end with its parent, where the system can: a killed command would leave it at work in a folder
    whose lock is free."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it was gone before
            raise SystemExit(1)

"""Pools of workers that end with their parent."""

import contextlib
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context

from robosim.base.jobs import end_with


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
    """Leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent)

"""Work in processes of its own, each pinned to a core: a crash is one answer less, and seconds are not disturbed."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

Work = tuple[str, Sequence[str]]
"""A module with a `main`, and the words that it is given; the core is added as the last."""


def worked_off(waiting: Sequence[Work], jobs: int) -> Iterator[tuple[int, Any, str]]:
    """Places in `waiting` as the work there comes to its end, with the JSON value of the last line that it printed, or
    None and its last words."""
    queue, active = list(enumerate(waiting)), {}
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    try:
        while queue or active:
            for core in cores[:jobs]:
                if queue and core not in active:
                    place, work = queue.pop(0)
                    active[core] = (place, started(work, core))
            time.sleep(0.02)
            for core, (place, process) in list(active.items()):
                if process.poll() is not None:
                    del active[core]
                    yield place, *answer(process)
    finally:
        for _, process in active.values():
            process.kill()


def started(work: Work, core: int) -> subprocess.Popen:
    """The process of a piece of work."""
    return subprocess.Popen([sys.executable, "-m", work[0], *work[1], str(core)], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})


def answer(process: subprocess.Popen) -> tuple[Any, str]:
    """What a process said: a value, or its last words."""
    said, complained = process.communicate()
    try:
        return json.loads(said.strip().splitlines()[-1]), ""
    except (IndexError, ValueError):
        return None, (complained.strip().splitlines() or [f"ended with {process.returncode}"])[-1]


def pin(core: str) -> None:
    """Keep this process on a core, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})

"""Work in processes of its own, each pinned to a core: a crash is one answer less, and seconds are not disturbed."""

import ctypes
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from typing import IO, Any, NamedTuple

PR_SET_PDEATHSIG = 1
"""linux/prctl.h"""
PARENT = "ROBOSIM_PARENT"
"""Variable with the process that began this one."""
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
                if process.process.poll() is not None:
                    del active[core]
                    yield place, *answer(process)
    finally:
        for _, process in active.values():
            process.process.kill()


class Started(NamedTuple):
    """A process, and where its words go."""

    process: subprocess.Popen
    said: IO[str]
    complained: IO[str]


def started(work: Work, core: int) -> Started:
    """The process of a piece of work."""
    said, complained = (tempfile.TemporaryFile("w+") for _ in range(2))  # noqa: SIM115  (a full pipe would stop it)
    process = subprocess.Popen([sys.executable, "-m", work[0], *work[1], str(core)], stdout=said, stderr=complained,
                               env={**os.environ, "OMP_NUM_THREADS": "1", PARENT: str(os.getpid())})
    return Started(process, said, complained)


def answer(started: Started) -> tuple[Any, str]:
    """What a process said: a value, or why it ended."""
    lines = []
    for file in (started.said, started.complained):
        file.seek(0)
        lines.append(file.read().strip().splitlines())
        file.close()
    code = started.process.wait()
    if code < 0:
        return None, f"killed by signal {-code}"
    try:
        return json.loads(lines[0][-1]), ""
    except (IndexError, ValueError):
        return None, (lines[1] or [f"ended with {code}"])[-1]


def pin(core: str) -> None:
    """Keep this process on a core, and let it end with the one that began it, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})
    if sys.platform == "linux":  # a killed report would leave its case behind, on the core that the next one times on
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.environ.get(PARENT, str(os.getppid())) != str(os.getppid()):  # it was gone before
            raise SystemExit(1)

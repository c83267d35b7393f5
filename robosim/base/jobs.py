"""Jobs in processes of their own, each pinned to a core.

A crash costs one result, and measured times are not disturbed by other jobs.
"""

import ctypes
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from typing import IO, Any, NamedTuple

PR_SET_PDEATHSIG = 1
"""Option of prctl: the signal to get when the parent ends. Source: linux/prctl.h."""
PARENT = "ROBOSIM_PARENT"
"""Environment variable with the id of the process that started a job."""
ANY_CORE = "any"
"""In place of the core, for a job of a cluster: which core it has, the cluster chooses."""
Job = tuple[str, Sequence[str]]
"""A module with a `main` and its arguments; the core is added as the last one. It prints JSON on its last line."""


Runner = Callable[[Sequence[Job]], Iterator[tuple[int, Any, str]]]
"""Runs jobs elsewhere, and yields them as `run_jobs` does."""


class RunningJob(NamedTuple):
    """A job's process and the files that take its output; a full pipe would stop it."""

    process: subprocess.Popen
    stdout: IO[str]
    stderr: IO[str]


def run_jobs(jobs: Sequence[Job], processes: int, runner: Runner | None = None) -> Iterator[tuple[int, Any, str]]:
    """Run jobs, as many at a time as there are processes, and yield each as it ends; or have a runner run them.

    Yields its index, the JSON value of the last line on stdout, and "". Where there is no such value it is None, and
    the last line on stderr, or how the process ended, is the reason.
    """
    if runner is not None:
        yield from runner(jobs)
        return
    waiting, running = list(enumerate(jobs)), {}
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    try:
        while waiting or running:
            for core in cores[:processes]:
                if waiting and core not in running:
                    index, job = waiting.pop(0)
                    running[core] = (index, _start(job, core))
            time.sleep(0.02)
            for core, (index, job) in list(running.items()):
                if job.process.poll() is not None:
                    del running[core]
                    yield index, *_result(job)
    finally:
        for _, job in running.values():
            job.process.kill()


def _start(job: Job, core: int) -> RunningJob:
    """Start a job's process."""
    stdout, stderr = (tempfile.TemporaryFile("w+") for _ in range(2))  # noqa: SIM115  (closed with the result)
    module, arguments = job
    process = subprocess.Popen([sys.executable, "-m", module, *arguments, str(core)], stdout=stdout, stderr=stderr,
                               env={**os.environ, "OMP_NUM_THREADS": "1", PARENT: str(os.getpid())})
    return RunningJob(process, stdout, stderr)


def _result(job: RunningJob) -> tuple[Any, str]:
    """Return the value that an ended job printed and "", or None and the reason."""
    lines = []
    for file in (job.stdout, job.stderr):
        file.seek(0)
        lines.append(file.read().strip().splitlines())
        file.close()
    code = job.process.wait()
    if code < 0:
        return None, f"killed by signal {-code}"
    try:
        return json.loads(lines[0][-1]), ""
    except (IndexError, ValueError):
        return None, (lines[1] or [f"ended with exit code {code}"])[-1]


def pin_to_core(core: str) -> None:
    """Pin this process to a core, unless on ANY_CORE, and, on Linux, end it together with the process that started it.

    A job that outlived a killed report would disturb the times measured on its core.
    """
    if core == ANY_CORE:
        return
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.environ.get(PARENT, str(os.getppid())) != str(os.getppid()):  # the parent ended before prctl
            raise SystemExit(1)

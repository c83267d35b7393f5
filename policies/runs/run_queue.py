"""A queue of runs, each in a process of its own, several at a time."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from itertools import islice

from tqdm import tqdm

from policies.learning.files import is_locked
from policies.runs.sweep_file import SweepRun

GRACE = 30.0
"""Time [s] that a run has to end after an interrupt."""
POLL = 0.2
"""Time [s] between two checks of the processes."""


def run_queue(runs: list[SweepRun], jobs: int, total: int) -> list[tuple[SweepRun, str]]:
    """Run all of them, `jobs` at a time; return those that failed, with the reason.

    Runs that another process has locked, as one that a killed sweep has left, are waited for. total: number of runs of
    the sweep, for the progress bar. On an exception, such as Ctrl-C, the processes are interrupted.
    """
    waiting, active, failed = list(runs), [], []
    progress = tqdm(initial=total - len(runs), total=total, desc="runs", file=sys.stderr)
    try:
        while waiting or active:
            startable = (run for run in waiting if not is_locked(run.out))  # lazy: each check opens a file
            for run in list(islice(startable, jobs - len(active))):
                waiting.remove(run)
                if run.state == "finished":  # by a process that a killed sweep has left
                    progress.update()
                else:
                    active.append((run, start_process(run)))
            time.sleep(POLL)
            for run, process in [pair for pair in active if pair[1].poll() is not None]:
                active.remove((run, process))
                if process.returncode != 0 and is_locked(run.out):  # a process of a killed sweep took the lock first
                    waiting.append(run)
                    continue
                progress.update()
                if process.returncode != 0 and run.state != "finished":
                    failed.append((run, failure_reason(run, process.returncode)))
    finally:
        progress.close()
        interrupt([process for _, process in active])
    return failed


def start_process(run: SweepRun) -> subprocess.Popen:
    """Start a run's process; its stdout and stderr are appended to log.txt of its folder."""
    run.out.mkdir(parents=True, exist_ok=True)
    with (run.out / "log.txt").open("a") as log:
        return subprocess.Popen([sys.executable, "-m", "robosim", *run.arguments], stdout=log, stderr=log,
                                env={**os.environ, "OMP_NUM_THREADS": "1"},
                                start_new_session=True)  # so that a Ctrl-C reaches it once, through `interrupt`


def interrupt(processes: list[subprocess.Popen]) -> None:
    """Interrupt processes as Ctrl-C does, so that each stores that it was stopped; kill them after GRACE."""
    for process in processes:
        process.send_signal(signal.SIGINT)
    for process in processes:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(GRACE)
        process.kill()


def failure_reason(run: SweepRun, code: int) -> str:
    """Return why a process ended: the signal that killed it, or the last line of its log."""
    if code < 0:
        return f"killed by signal {-code}"
    lines = (run.out / "log.txt").read_text().strip().splitlines()
    return lines[-1] if lines else f"exit status {code}"

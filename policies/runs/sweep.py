"""`robosim sweep`: runs of a sweep, each in a process of its own, several at a time or as jobs of a cluster."""

import contextlib
import subprocess
import sys
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from policies.learning.options import check_at_least
from policies.runs.sweep_file import SweepRun, load_sweep, plan_runs
from robosim.base.files import keep_status, write_json
from robosim.base.jobs import describe_end, start_command
from robosim.base.output_folder import is_locked
from robosim.base.progress import Progress
from robosim.config.settings import Setting

GRACE = 30.0
"""Time [s] that a run has to end after an interrupt."""
POLL = 0.2
"""Time [s] between two checks of the processes."""


def sweep(path: Path, *, jobs: int = 1, launcher: Any = None, dry_run: bool = False,
          settings: Sequence[Setting] = ()) -> int:
    """Run what is not finished of a sweep file; return 0, or 1 when some runs failed.
    jobs: processes at a time. launcher: what runs them elsewhere, with `configure` and `run`; None: here. dry_run: only
    print the runs. settings: in place of values of the file. Raises robosim.ConfigError for a wrong file,
    mpm.InvalidValue for jobs below 1."""
    check_at_least(1, {"--jobs": jobs})
    file = load_sweep(path, settings)
    runs = plan_runs(file)
    unfinished = [run for run in runs if run.state != "finished"]
    print(f"{len(runs)} runs, {len(runs) - len(unfinished)} finished")
    if dry_run:
        for run in unfinished:
            print(f"  {run.state:9s} robosim {' '.join(run.arguments)}")
        return 0
    if launcher is not None:
        launcher.configure(file.launch)
    file.out.mkdir(parents=True, exist_ok=True)
    with keep_status(file.out) as failures:
        try:
            failed = run_queue(unfinished, jobs, len(runs)) if launcher is None else \
                run_elsewhere(unfinished, launcher, file.out / "launch", len(runs))
        finally:
            write_json(file.out / "sweep.json", {"runs": {str(run.out): run.state for run in runs}})
        failures += [f"{run.out}: {reason}" for run, reason in failed]
    for failure in failures:
        print(f"failed: {failure}", file=sys.stderr)
    return 1 if failures else 0


def run_queue(runs: list[SweepRun], jobs: int, total: int) -> list[tuple[SweepRun, str]]:
    """Run all of them, `jobs` at a time; return those that failed, with the reason.
    Runs that another process has locked, as one that a killed sweep has left, are waited for. total: number of runs of
    the sweep, for the progress bar. On an exception, such as Ctrl-C, the processes are interrupted."""
    waiting, active, failed = list(runs), [], []
    progress = Progress(initial=total - len(runs), total=total, desc="sweep", unit="runs")
    try:
        while waiting or active:
            startable = (run for run in waiting if not is_locked(run.out))  # lazy: each check opens a file
            for run in list(islice(startable, jobs - len(active))):
                waiting.remove(run)
                if run.state == "finished":  # by a process that a killed sweep has left
                    progress.update()
                else:
                    run.out.mkdir(parents=True, exist_ok=True)
                    with run.log.open("a") as log:
                        active.append((run, start_command(run.arguments, log)))
            time.sleep(POLL)
            for run, process in [pair for pair in active if pair[1].poll() is not None]:
                active.remove((run, process))
                if process.returncode != 0 and is_locked(run.out):  # a process of a killed sweep took the lock first
                    waiting.append(run)
                    continue
                progress.update()
                if process.returncode != 0 and run.state != "finished":
                    failed.append((run, describe_end(process.returncode, run.log)))
    finally:
        progress.close()
        for _, process in active:  # so that each writes its checkpoint
            process.terminate()
        for _, process in active:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(GRACE)
            process.kill()
    return failed


def run_elsewhere(runs: list[SweepRun], launcher: Any, folder: Path, total: int) -> list[tuple[SweepRun, str]]:
    """Run all of them by a launcher; return those that failed, with the reason. folder: of what the launcher writes."""
    commands = [(["robosim", *run.arguments], run.log.resolve()) for run in runs]
    failed, progress = [], Progress(initial=total - len(runs), total=total, desc="sweep", unit="runs")
    for ended in launcher.run(commands, folder.resolve()):
        progress.update()
        run = runs[ended.index]
        if ended.reason or run.state != "finished":
            failed.append((run, ended.reason or f"ended, but {run.out} is {run.state}"))
    progress.close()
    return failed

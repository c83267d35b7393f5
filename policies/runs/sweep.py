"""`robosim sweep`: tasks x methods x seeds, each a run in a folder and a process of its own."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from itertools import islice, product
from pathlib import Path
from typing import Any, NamedTuple

import pydantic
import yaml
from pydantic import ConfigDict, Field, PositiveInt
from tqdm import tqdm

import mpm
from policies.learning.bundled import bundled_names
from policies.learning.files import write_json
from policies.learning.presets import Change, in_file, in_words, known, load_preset, strange

GRACE = 30.0
"""Time [s] that a run has to end when the sweep is stopped."""


class SweepFile(pydantic.BaseModel):
    """What to run."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    tasks: list[str] = Field(min_length=1)
    methods: list[str] = Field(min_length=1)
    seeds: list[int] = Field(min_length=1)
    demos: str | None = None
    """Folder of the demonstrations; {task} is the task's name."""
    frames: str | None = None
    """The same of the roll-outs that a network learns from."""
    episodes: PositiveInt | None = None
    options: list[str] = []  # noqa: RUF012
    """Further words for `robosim train`."""
    out: Path
    """Runs go to out/task/method/seed_k."""


class Run(NamedTuple):
    """One run."""

    out: Path
    words: list[str]
    """Of its command."""
    preset: dict[str, Any]

    @property
    def state(self) -> str:
        """finished, failed, or what else its folder says; "new" where there is none."""
        try:
            manifest = json.loads((self.out / "manifest.json").read_text())
            found = known(manifest["preset"])
            given = {name: found.get(name) for name in ("obs", "episodes")}  # which words may say
            given = found if "--set" in self.words else given
            if manifest["command"].split(" ", 1)[-1] != " ".join(self.words) or {**self.preset, **given} != found:
                return "another"  # which `robosim train` refuses by name
            return str(json.loads((self.out / "status.json").read_text())["state"])
        except (OSError, ValueError, KeyError):
            return "new"


def load(path: Path, change: Change | None = None) -> SweepFile:
    """Load a sweep's file; raises mpm.InvalidValue for one that cannot be used.

    change: of its table, before it is checked.
    """
    try:
        table = yaml.safe_load(path.read_text())
        return SweepFile(**(change(table) if change else table))
    except (OSError, yaml.YAMLError, pydantic.ValidationError, TypeError) as error:
        raise mpm.InvalidValue(f"{path}: {in_words(error, SweepFile)}") from error


def planned(file: SweepFile) -> list[Run]:
    """All runs of a sweep, seeds outermost, so that a sweep that is stopped has whole rows."""
    runs, unknown = [], [task for task in file.tasks if strange(task)]
    if unknown:
        raise mpm.InvalidValue(f"tasks {', '.join(unknown)}; accepted: {', '.join(bundled_names('tasks'))}, a "
                               f"task's .yaml file, or an id of Gymnasium such as Pendulum-v1")
    for seed, task, method in product(file.seeds, file.tasks, file.methods):
        name = Path(task).stem if in_file(task) else task
        out = file.out / name / Path(method).stem / f"seed_{seed}"
        words = ["train", method, task, "--seed", str(seed), "--out", str(out), *file.options]
        preset = load_preset(method)
        takes = (("demos", file.demos, preset.shown or None), ("frames", file.frames, preset.graph))
        for what, given, needed in takes:
            if needed is not None:
                if given is None:
                    raise mpm.InvalidValue(f"method {method} learns from {what}; give their folder as `{what}`")
                words += [f"--{what}", given.replace("{task}", name)]
        changes = {} if file.episodes is None else {"episodes": file.episodes}
        if file.episodes is not None:
            words += ["--episodes", str(file.episodes)]
        runs.append(Run(out, words, preset.model_copy(update=changes).model_dump()))
    if len({run.out for run in runs}) < len(runs):
        raise mpm.InvalidValue("two runs would share a folder; accepted: tasks, methods and seeds of different names")
    return runs


def sweep(path: Path, *, jobs: int = 1, slurm: str | None = None, dry: bool = False,
          change: Change | None = None) -> int:
    """Run what is not finished; returns 0 when everything is, 1 when some runs failed."""
    if jobs < 1:
        raise mpm.InvalidValue(f"--jobs {jobs}; accepted: 1 or more")
    file = load(path, change)
    runs = planned(file)
    waiting = [run for run in runs if run.state != "finished"]
    print(f"{len(runs)} runs, {len(runs) - len(waiting)} finished")
    if dry:
        for run in waiting:
            print(f"  {run.state:9s} robosim {' '.join(run.words)}")
        return 0
    if slurm is not None:
        return submit(waiting, slurm, path)
    failed = work_off(waiting, jobs, len(runs))
    for run, reason in failed:
        print(f"failed: {run.out}: {reason}", file=sys.stderr)
    write_json(file.out / "sweep.json", {"runs": {str(run.out): run.state for run in runs}})
    return 1 if failed else 0


def work_off(waiting: list[Run], jobs: int, total: int) -> list[tuple[Run, str]]:
    """Run them, so many at a time; returns those that failed, with their last words."""
    queue, active, failed = list(waiting), [], []
    progress = tqdm(initial=total - len(waiting), total=total, desc="runs", file=sys.stderr)
    try:
        while queue or active:
            free = (run for run in queue if not at_work(run))  # each look opens a file: no more of them than needed
            for run in list(islice(free, jobs - len(active))):
                queue.remove(run)
                if run.state == "finished":  # by a process that a killed sweep has left behind
                    progress.update()
                else:
                    active.append(started(run))
            time.sleep(0.2)
            for run, process in [pair for pair in active if pair[1].poll() is not None]:
                active.remove((run, process))
                if process.returncode != 0 and at_work(run):  # one that a killed sweep left behind was first, after all
                    queue.append(run)
                    continue
                progress.update()
                if process.returncode != 0 and run.state != "finished":
                    failed.append((run, last_words(run, process.returncode)))
    finally:
        progress.close()
        for _, process in active:  # as by Ctrl-C, so that each writes down that it was stopped
            process.send_signal(signal.SIGINT)
        for _, process in active:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(GRACE)
            process.kill()
    return failed


def last_words(run: Run, code: int) -> str:
    """Why a process ended: the signal that killed it, or the last line that it wrote."""
    if code < 0:
        return f"killed by signal {-code}"
    lines = (run.out / "log.txt").read_text().strip().splitlines()
    return lines[-1] if lines else f"ended with {code}"


def at_work(run: Run) -> bool:
    """Whether a process is at work in the run's folder, such as one that a killed sweep has left behind."""
    from policies.runs.run_folder import locked

    return locked(run.out)


def started(run: Run) -> tuple[Run, subprocess.Popen]:
    """The run's process; what it says goes to log.txt in its folder."""
    run.out.mkdir(parents=True, exist_ok=True)
    with (run.out / "log.txt").open("a") as log:
        return run, subprocess.Popen([sys.executable, "-m", "robosim", *run.words], stdout=log, stderr=log,
                                     env={**os.environ, "OMP_NUM_THREADS": "1"},
                                     start_new_session=True)  # a Ctrl-C reaches it once, through the sweep


def submit(waiting: list[Run], partition: str, path: Path) -> int:
    """Hand runs to SLURM as an array of jobs of one core each."""
    try:
        import submitit  # pyright: ignore[reportMissingImports]  (only where there is a cluster)
    except ImportError as error:
        raise mpm.InvalidValue("--slurm needs submitit: pip install submitit") from error
    executor = submitit.AutoExecutor(folder=str(path.with_suffix(".slurm")))
    executor.update_parameters(slurm_partition=partition, cpus_per_task=1, timeout_min=24 * 60)
    jobs = executor.map_array(finish, waiting)
    print(f"{len(jobs)} jobs: {', '.join(job.job_id for job in jobs)}")
    return 0


def finish(run: Run) -> int:
    """One run to its end, in a process of its own."""
    return started(run)[1].wait()

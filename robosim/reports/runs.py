"""Runs of cases, each in a process of its own that is pinned to one core; what is finished is not run again."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from robosim.cases import find
from robosim.cases.record import Record
from robosim.errors import ConfigError
from robosim.reports.provenance import version_of

FIELDS = ("case", "choices", "code", "record", "failed")


@dataclass(frozen=True)
class Run:
    """A case with its choices, before or after it was run."""

    case: str
    choices: dict[str, Any]
    code: str
    """Version of what the case exercises."""
    record: Record | None = None
    failed: str = ""
    """Why there is no record."""

    @property
    def key(self) -> str:
        """The same for the same work."""
        return json.dumps([self.case, self.choices, self.code], sort_keys=True)

    @property
    def done(self) -> bool:
        """Whether it was run, well or not."""
        return self.record is not None or bool(self.failed)


def planned(names: list[str], quick: bool) -> list[Run]:
    """Runs of cases, with the version of the code as it is now."""
    return [Run(name, choices, version_of(f"robosim.cases.{name}")) for name in names
            for choices in (find(name).QUICK if quick else find(name).SWEEP)]


def read(path: Path) -> list[Run]:
    """Runs that were written down; raises ConfigError for a file that holds anything else."""
    runs = []
    for k, line in enumerate(path.read_text().splitlines() if path.is_file() else [], 1):
        try:
            told = json.loads(line)
            record = Record(**told["record"]) if told["record"] else None
            runs.append(Run(**{**{key: told[key] for key in FIELDS}, "record": record}))
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"{path}, line {k}: not a run of a report ({type(error).__name__}: {error}); it is left "
                              f"as it is: give another --out, or move the file away") from error
    return runs


def written(path: Path, run: Run) -> None:
    """Append a run to a file, whole or not at all."""
    line = json.dumps(asdict(run), sort_keys=True) + "\n"
    with path.open("a") as file:
        file.write(line)
        file.flush()
        os.fsync(file.fileno())


def carried_out(runs: list[Run], path: Path, jobs: int) -> list[Run]:
    """The runs with their records, from the file where they stand there, otherwise run now, `jobs` at a time."""
    known = {run.key: run for run in read(path) if run.record is not None}  # what failed is tried again
    waiting = [run for run in runs if run.key not in known]
    progress = tqdm(initial=len(runs) - len(waiting), total=len(runs), unit="run", file=sys.stderr)
    for run in worked_off(waiting, jobs):
        written(path, run)
        known[run.key] = run
        progress.set_postfix_str(run.case)
        progress.update()
    progress.close()
    return [known[run.key] for run in runs]


def worked_off(waiting: list[Run], jobs: int) -> Iterator[Run]:
    """Runs as they come to their end."""
    queue, active = list(waiting), {}
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    try:
        while queue or active:
            for core in cores[:jobs]:
                if queue and core not in active:
                    run = queue.pop(0)
                    active[core] = (run, started(run, core))
            time.sleep(0.02)
            for core, (run, process) in list(active.items()):
                if process.poll() is not None:
                    del active[core]
                    yield answered(run, process)
    finally:
        for _, process in active.values():
            process.kill()


def started(run: Run, core: int) -> subprocess.Popen:
    """A process for one run."""
    words = [sys.executable, "-m", "robosim.reports.one", run.case, json.dumps(run.choices), str(core)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            env={**os.environ, "OMP_NUM_THREADS": "1", "MUJOCO_GL": "egl"})


def answered(run: Run, process: subprocess.Popen) -> Run:
    """What the process said: a record in its last line, or its last words."""
    said, complained = process.communicate()
    try:
        return Run(run.case, run.choices, run.code, Record(**json.loads(said.strip().splitlines()[-1])))
    except (IndexError, ValueError, TypeError):
        last = (complained.strip().splitlines() or [f"ended with {process.returncode}"])[-1]
        return Run(run.case, run.choices, run.code, failed=last)

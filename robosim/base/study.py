"""A study: a list of jobs, each a function with arguments, and a row of each in a file of its own.
A row is kept as soon as its job ends, in a folder that another call continues: what is there, of the same arguments and
code, is not run again. A job that crashes costs its own row, and says why. Each job is a process of its own, pinned to
a core here, or a job of a cluster: `python -m robosim.base.study FILE` runs the job that is written in FILE."""

import contextlib
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from robosim.base.digests import code_digest, digest
from robosim.base.files import ROWS, remove_temporary, write_text
from robosim.base.input_files import MAX_JSON, check_form, read_text
from robosim.base.jobs import PARENT, Launcher, end_with, run_here
from robosim.base.progress import Progress
from robosim.base.provenance import commit, processor

ROW = {"key": str, "checksum": str, "value": object}
"""Form of a row's file; it has also the job, commit, machine and digest of the code."""


class Job(NamedTuple):
    """A function, and the arguments that it is called with."""

    function: str
    """"module:function", which returns what JSON can hold; NaN and infinity, too."""
    arguments: dict[str, Any]
    """Of JSON."""
    depends: Any = None
    """What else the value depends on, such as the content of files that the arguments name."""
    places: dict[str, str] = {}  # noqa: RUF012  (never changed)
    """Further arguments that say where the function writes; the value does not depend on them."""
    exercises: str = ""
    """Module whose code, with what it imports, the value depends on; empty: the function's."""

    @property
    def code(self) -> str:
        """Digest of the code that the value depends on."""
        return code_digest(self.exercises or self.function.split(":")[0])

    @property
    def key(self) -> str:
        """What the value depends on, in twelve hexadecimal digits."""
        return digest([self.function, self.arguments, self.depends, self.code])


class Row(NamedTuple):
    """A job's value, or why there is none."""

    job: Job
    value: Any
    failed: str = ""
    """Reason of a job that has no value."""


class Store:
    """Values in a folder, one file each, found by keys that say what they depend on."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, key: str) -> Path:
        """Return the file of a key."""
        return self.folder / f"{key}.json"

    def find(self, key: str) -> tuple[Any] | None:
        """Return a stored value in a tuple of one; None where there is none, or the file is damaged."""
        try:
            stored = json.loads(read_text(self.path(key), MAX_JSON))  # reads NaN, too
            check_form(stored, ROW)
            if (stored["key"], stored["checksum"]) != (key, digest(stored["value"])):
                raise ValueError("checksum")
            return (stored["value"],)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            print(f"robosim: {self.path(key)} is damaged ({error}); running the job again", file=sys.stderr)
            return None

    def keep(self, key: str, value: Any, **more: Any) -> None:
        """Store a value; more: its provenance."""
        self.folder.mkdir(parents=True, exist_ok=True)
        value = json.loads(json.dumps(value))  # as it is read
        write_text(self.path(key), json.dumps({"key": key, "checksum": digest(value), **more, "value": value}) + "\n")


class Study:
    """Runs jobs and keeps their rows in `folder`/rows; without a folder nothing is kept.
    processes: jobs at a time, here. launcher: runs them elsewhere."""

    def __init__(self, folder: Path | None, processes: int = 1, launcher: Launcher | None = None) -> None:
        self._temporary = tempfile.TemporaryDirectory(prefix="study_") if folder is None else None
        self.folder = Path(self._temporary.name) if self._temporary is not None else folder or Path()
        self.processes, self.launcher = processes, launcher
        self.store = Store((self.folder / ROWS).resolve())

    def run(self, jobs: Sequence[Job]) -> Iterator[tuple[int, Row]]:
        """Yield index and row of each job: first those that are stored, then each as it ends."""
        waiting = []
        for k, job in enumerate(jobs):
            found = self.store.find(job.key)
            if found is None:
                waiting.append(k)
            else:
                yield k, Row(job, *found)
        self.store.folder.mkdir(parents=True, exist_ok=True)
        commands = []
        for k in waiting:
            job = jobs[k]
            order = self.store.path(job.key).with_suffix(".job")
            write_text(order, json.dumps({**job._asdict(), "key": job.key}))
            commands.append((["robosim.base.study", str(order)], order.with_suffix(".log")))
        ends: Any = run_here(commands, self.processes) if self.launcher is None else \
            self.launcher.run(commands, (self.folder / "launch").resolve(), resumes=False)
        try:
            for index, reason in ends:
                job, (_, log) = jobs[waiting[index]], commands[index]
                found = None if reason else self.store.find(job.key)
                if found is None:
                    yield waiting[index], Row(job, None, reason or "left no result")
                else:
                    for path in (log, log.with_suffix(".job")):
                        path.unlink(missing_ok=True)
                    yield waiting[index], Row(job, *found)
        finally:
            if self.launcher is None:  # jobs elsewhere may be writing
                ends.close()
                remove_temporary(self.store.folder)

    def rows(self, jobs: Sequence[Job], name: str, unit: str = "runs") -> list[Row]:
        """Return the rows of all jobs, in order. name, unit: of the progress bar."""
        rows: dict[int, Row] = {}
        with Progress(total=len(jobs), desc=name, unit=unit) as progress:
            for k, row in self.run(jobs):
                rows[k] = row
                progress.update()
        return [rows[k] for k in range(len(jobs))]


def run_job(order: Path) -> None:
    """Run the job that a file has, and store its row in that folder, with the digest of the code here."""
    written = json.loads(order.read_text(encoding="utf-8"))
    job = Job(**{name: written[name] for name in Job._fields})
    module, _, name = job.function.partition(":")
    with contextlib.redirect_stdout(sys.stderr):
        value = getattr(import_module(module), name)(**job.arguments, **job.places)
    Store(order.parent).keep(written["key"], value, function=job.function, arguments=job.arguments, code=job.code,
                             commit=commit(), machine=processor())


if __name__ == "__main__":
    if PARENT in os.environ:
        end_with(int(os.environ.pop(PARENT)))
    run_job(Path(sys.argv[1]))

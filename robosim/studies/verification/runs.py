"""Runs of cases, each in a process of its own that is pinned to a core; finished runs are kept in a file.

Such a process is `python -m robosim.studies.verification.runs CASE CHOICES CORE`. With `--cell AXIS VALUE CORE` it runs
a cell of the stability report. CHOICES and VALUE are JSON.
"""

import json
import sys
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import mpm
from robosim.base.digests import code_digest
from robosim.base.errors import ConfigError
from robosim.base.files import append, write_text
from robosim.base.input_files import MAX_JSON, check_form, read_text
from robosim.base.jobs import Runner, pin_to_core, run_jobs
from robosim.base.progress import Progress
from robosim.studies.verification.cases import find, module_name
from robosim.studies.verification.cases.record import Record

WORKER = "robosim.studies.verification.runs"
"""This module, as a process of its own runs it: there `__name__` is another."""
BEGIN = '{"case": "'
"""Beginning of every line of the file."""
ROW = {"case": str, "choices": {str: object}, "code": str, "failed": str, "record": ({
    "case": str, "choices": {str: object}, "particles": int, "steps": int, "seconds": (float, None),
    "compile_seconds": (float, None), "errors": {str: (float, None)}, "readings": ({str: (float, None)}, ...),
    "peak_bytes": (int, ...)}, None)}
"""Form of a line."""
FIELDS = ("case", "choices", "code", "record", "failed")


@dataclass(frozen=True)
class Run:
    """A case with its choices, before or after it is run."""

    case: str
    choices: dict[str, Any]
    """Arguments of the case's `measure`."""
    code: str
    """Digest of the code that the case exercises."""
    record: Record | None = None
    """Result; None before the run or where it failed."""
    failed: str = ""
    """Why there is no record."""

    @property
    def key(self) -> str:
        """Identifies the work: case, choices and code."""
        return json.dumps([self.case, self.choices, self.code], sort_keys=True)


def plan_runs(names: list[str], quick: bool) -> list[Run]:
    """Return the runs of cases, with the digest of the present code; quick: of their quick sweeps."""
    return [Run(name, choices, code_digest(module_name(name))) for name in names
            for choices in (find(name).QUICK_SWEEP if quick else find(name).SWEEP)]


def read_runs(path: Path) -> list[Run]:
    """Read runs from a file; a last line that was cut off by a kill is removed from it.

    Raises ConfigError for a file that holds anything else, and leaves it unchanged.
    """
    runs = []
    try:
        text = read_text(path, MAX_JSON) if path.is_file() else ""
    except ValueError as error:
        raise ConfigError(f"{error}; it is left as it is: give another --out, or move the file away") from None
    complete = text[: text.rfind("\n") + 1]
    rest = text[len(complete) :]
    if rest.startswith(BEGIN) or (complete and rest and BEGIN.startswith(rest)):
        write_text(path, complete)
        text = complete
    for k, line in enumerate(text.splitlines(), 1):
        try:
            row = json.loads(line)
            check_form(json.loads(line, parse_constant=lambda name: None), ROW, "run")  # a run may have diverged
            record = Record(**row["record"]) if row["record"] else None
            runs.append(Run(**{**{key: row[key] for key in FIELDS}, "record": record}))
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise ConfigError(f"{path}, line {k}: not a run of a report ({type(error).__name__}: {error}); it is left "
                              f"as it is: give another --out, or move the file away") from error
    return runs


def append_run(path: Path, run: Run) -> None:
    """Append a run to a file and flush it to the disk."""
    append(path, (json.dumps(asdict(run), sort_keys=True) + "\n").encode())


def execute_runs(runs: list[Run], path: Path, jobs: int, runner: Runner | None = None) -> list[Run]:
    """Return the runs with their records, from the file or run now; failed runs are repeated.

    jobs: runs at a time, here; runner: runs them elsewhere.
    """
    known = {run.key: run for run in read_runs(path) if run.record is not None}
    waiting = [run for run in runs if run.key not in known]
    progress = Progress(initial=len(runs) - len(waiting), total=len(runs), desc="report", unit="runs")
    work = [(WORKER, (run.case, json.dumps(run.choices))) for run in waiting]
    for index, row, reason in run_jobs(work, jobs, runner):
        record = Record(**row) if row is not None else None
        run = replace(waiting[index], record=record, failed=reason)
        append_run(path, run)
        known[run.key] = run
        progress.set_postfix_str(run.case)
        progress.update()
    progress.close()
    return [known[run.key] for run in runs]


def main() -> None:
    """Run the case or the cell that the command line names, in this process, and print it as JSON."""
    *arguments, core = sys.argv[1:]
    pin_to_core(core)
    mpm.init()
    if arguments[0] == "--cell":
        from robosim.studies.verification.stability.field import run_cell  # here, so that reports of cases do without

        print(json.dumps(asdict(run_cell(arguments[1], json.loads(arguments[2])))))
        return
    case, choices = arguments
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.StrongCompression)  # some cases compress on purpose
        print(find(case).measure(**json.loads(choices)).to_json())


if __name__ == "__main__":
    main()

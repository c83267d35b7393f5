"""Runs of cases, each in a process of its own that is pinned to one core; what is finished is not run again."""

import json
import os
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from robosim.errors import ConfigError
from robosim.reports.jobs import run_jobs
from robosim.reports.provenance import code_digest
from robosim.verification.cases import find, module_name
from robosim.verification.cases.record import Record

BEGIN = '{"case": "'
"""What every line begins with."""
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


def planned(names: list[str], quick: bool) -> list[Run]:
    """Runs of cases, with the version of the code as it is now."""
    return [Run(name, choices, code_digest(module_name(name))) for name in names
            for choices in (find(name).QUICK if quick else find(name).SWEEP)]


def read(path: Path) -> list[Run]:
    """Runs that were written down; raises ConfigError for a file that holds anything else."""
    runs = []
    text = path.read_text() if path.is_file() else ""
    whole = text[: text.rfind("\n") + 1]
    if text != whole and text[len(whole) :].startswith(BEGIN):  # a run that was killed while it wrote
        path.write_text(whole)
        text = whole
    for k, line in enumerate(text.splitlines(), 1):
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
    work = [("robosim.verification.run_one", (run.case, json.dumps(run.choices))) for run in waiting]
    for place, found, failed in run_jobs(work, jobs):
        record = Record(**found) if found is not None else None
        run = replace(waiting[place], record=record, failed=failed)
        written(path, run)
        known[run.key] = run
        progress.set_postfix_str(run.case)
        progress.update()
    progress.close()
    return [known[run.key] for run in runs]

"""Runs of cases, as jobs of a study."""

import warnings
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mpm
from robosim.base.jobs import Launcher
from robosim.base.study import Job, Study
from robosim.studies.verification.cases import find, module_name
from robosim.studies.verification.cases.case import Record


@dataclass(frozen=True)
class Run:
    """A run of a case."""

    case: str
    choices: dict[str, Any]
    code: str
    """Digest of the code that the case exercises."""
    record: Record | None = None
    failed: str = ""
    """Why there is no record."""


def execute_runs(names: Iterable[str], quick: bool, folder: Path, processes: int,
                 launcher: Launcher | None) -> list[Run]:
    """Return the runs of cases, stored in the folder or made now; quick: of their quick sweeps."""
    jobs = [Job("robosim.studies.verification.runs:measure_case", {"case": name, "choices": choices},
                exercises=module_name(name))
            for name in names for choices in (find(name).quick if quick else find(name).sweep)]
    return [Run(**row.job.arguments, code=row.job.code, failed=row.failed,
                record=None if row.value is None else Record(**row.value))
            for row in Study(folder, processes, launcher).rows(jobs, "report")]


def measure_case(case: str, choices: dict[str, Any]) -> dict[str, Any]:
    """Run a case; return its record."""
    mpm.init()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.StrongCompression)  # some cases compress on purpose
        return asdict(find(case)(**choices))

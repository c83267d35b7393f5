"""Runs of cases, as jobs of a study, and their analysis: expectations, Pareto front of error and time, orders."""

import warnings
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import mpm
from robosim.base.jobs import Launcher
from robosim.base.study import Job, Study
from robosim.studies.verification.cases import find, module_name
from robosim.studies.verification.cases.case import Case, Record, value_of
from robosim.studies.verification.cases.expectations import Within, judge

VERDICTS = "A case passes if all of its expectations are met; it is weak if all ranges of its main error are held, "\
           "but not all that else is expected."


@dataclass(frozen=True)
class Run:
    """A run of a case."""

    case: str
    choices: dict[str, Any]
    code: str
    """Digest of the code that the case exercises."""
    record: Record | None = None
    failed: str = ""


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


def group_series(case: str, records: list[Record]) -> dict[str, list[Record]]:
    """Group runs that differ only in resolution, coarse to fine; the label names their common choices."""
    physics, groups = find(case), {}
    varied = [key for key in (records[0].choices if records else {})
              if len({str(r.choices.get(key)) for r in records}) > 1 and key != physics.resolution]
    for record in records:
        if physics.main_error in record.errors:
            label = ", ".join(f"{key} {record.choices.get(key)}" for key in varied) or "all"
            groups.setdefault(label, []).append(record)
    sign = -1.0 if physics.resolution == "cell" else 1.0  # a cell's size shrinks with refinement
    for members in groups.values():
        members.sort(key=lambda r: sign * float(r.choices.get(physics.resolution or "") or 0.0))
    return groups


def pareto_front(points: list[tuple[float, float]]) -> list[int]:
    """Return the indices of points (seconds, error) that no other point beats in both, by seconds."""
    least, front = np.inf, []
    for k in sorted(range(len(points)), key=lambda k: points[k]):
        if points[k][1] < least:
            least = points[k][1]
            front.append(k)
    return front


def time_to_error(target: float, points: list[tuple[float, float]]) -> float | None:
    """Return the seconds at which a series (seconds, error) reaches an error, by interpolation of logarithms.
    None where it does not reach it."""
    for (t0, e0), (t1, e1) in pairwise(points):
        if e0 > target >= e1 > 0:
            return float(np.exp(np.interp(np.log(target), np.log([e1, e0]), np.log([t1, t0]))))
    return points[0][0] if points and points[0][1] <= target else None


def observed_orders(records: list[Record], name: str, resolution: str | None) -> list[float]:
    """Return the observed orders of convergence of an error from run to run."""
    pairs = [(float(r.choices[resolution] or 0.0), abs(value_of(r, name))) for r in records] if resolution else []
    return [float(np.log(e0 / e1) / abs(np.log(n1 / n0))) for (n0, e0), (n1, e1) in pairwise(pairs)
            if n0 != n1 and e0 > 0 and e1 > 0]


def summarize_case(case: str, runs: list[Run]) -> dict[str, Any]:
    """Return a case's part of report.json."""
    physics, series = find(case), []
    records = [run.record for run in runs if run.record is not None]
    for label, members in group_series(case, records).items():
        points = [(r.seconds, abs(value_of(r, physics.main_error))) for r in members]
        series.append({
            "label": label, "points": points, "front": pareto_front(points),
            "orders": observed_orders(members, physics.main_error, physics.resolution),
            "seconds_to_1_percent": time_to_error(0.01, points)})
    claims = replace_non_finite([{**f._asdict(), "verdict": f.verdict} for f in judge(physics, records)])
    values = sorted((value_of(r, physics.main_error) for r in records if physics.main_error in r.errors), key=abs)
    return {"case": case, "source": physics.source, "headline": physics.main_error, "claims": claims,
            "range": [values[0], values[-1]] if values else [None, None],
            "unit": physics.units.get(physics.main_error, ""), "verdict": verdict_of(physics, claims, runs),
            "failed": [{"choices": run.choices, "reason": run.failed} for run in runs if run.failed], "series": series}


def verdict_of(physics: Case, claims: list[dict[str, Any]], runs: list[Run]) -> str:
    """Return "pass", "weak" or "fail" of a case, see VERDICTS; "not run" where no expectation has a run."""
    if any(run.failed for run in runs):
        return "fail"
    verdicts = {claim["verdict"] for claim in claims}
    if any(claim["verdict"] == "fail" and isinstance(one, Within) and one.name == physics.main_error
           for one, claim in zip(physics.expectations, claims)):
        return "fail"
    return "weak" if "fail" in verdicts else "pass" if "pass" in verdicts else "not run"


def picture_of(records: list[Record]) -> str:
    """Return the picture of the run with the most particles that has one, else an empty text."""
    drawn = [record for record in records if record.picture]
    return max(drawn, key=lambda record: record.particles).picture if drawn else ""


def replace_non_finite(value: Any) -> Any:
    """Return a copy of a JSON value with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: replace_non_finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [replace_non_finite(part) for part in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value

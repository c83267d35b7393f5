"""What runs of a case amount to: its claims judged, the front of error and time, the time to an error of 1 %."""

from dataclasses import asdict
from itertools import pairwise
from typing import Any

import numpy as np

from robosim.verification.cases import find
from robosim.verification.cases.criteria import Finding, value
from robosim.verification.cases.record import Record
from robosim.verification.results import Run

GOAL = 0.01
"""Error whose price in seconds is told."""


def findings(case: str, records: list[Record]) -> list[Finding]:
    """What the runs say to the case's claims."""
    return [check.judge(records) for check in find(case).CHECKS]


def series(case: str, records: list[Record]) -> dict[str, list[Record]]:
    """Runs that differ in resolution only, coarse to fine, under the choices that they share."""
    module, groups = find(case), {}
    varied = [key for key in (records[0].choices if records else {})
              if len({str(r.choices.get(key)) for r in records}) > 1 and key != module.KNOB]
    for record in records:
        if module.HEADLINE in record.errors:
            label = ", ".join(f"{key} {record.choices.get(key)}" for key in varied) or "all"
            groups.setdefault(label, []).append(record)
    finer_last = -1.0 if module.KNOB == "cell" else 1.0
    for members in groups.values():
        members.sort(key=lambda r: finer_last * float(r.choices.get(module.KNOB) or 0.0) if module.KNOB else 0.0)
    return groups


def front(points: list[tuple[float, float]]) -> list[int]:
    """Indices of points (seconds, error) that no other point beats in both, by seconds."""
    best, kept = np.inf, []
    for k in sorted(range(len(points)), key=lambda k: points[k]):
        if points[k][1] < best:
            best = points[k][1]
            kept.append(k)
    return kept


def seconds_to(goal: float, members: list[tuple[float, float]]) -> float | None:
    """Seconds at which a series (seconds, error) reaches an error, between runs in logarithms; None where it never
    does."""
    for (t0, e0), (t1, e1) in pairwise(members):
        if e0 > goal >= e1 > 0:
            return float(np.exp(np.interp(np.log(goal), np.log([e1, e0]), np.log([t1, t0]))))
    return members[0][0] if members and members[0][1] <= goal else None


def orders(members: list[Record], name: str, knob: str | None) -> list[float]:
    """Observed orders from run to run."""
    if knob is None:
        return []
    pairs = [(float(r.choices[knob] or 0.0), abs(value(r, name))) for r in members]
    return [float(np.log(e0 / e1) / abs(np.log(n1 / n0))) for (n0, e0), (n1, e1) in pairwise(pairs)
            if n0 != n1 and e0 > 0 and e1 > 0]


def analysed(case: str, runs: list[Run]) -> dict[str, Any]:
    """A case's part of report.json."""
    module = find(case)
    records = [run.record for run in runs if run.record is not None]
    told = {"case": case, "source": module.SOURCE, "headline": module.HEADLINE,
            "claims": [{**asdict(f), "verdict": f.verdict, "high": number(f.high), "low": number(f.low),
                        "found": number(f.found)} for f in findings(case, records)],
            "failed": [{"choices": run.choices, "reason": run.failed} for run in runs if run.failed], "series": []}
    for label, members in series(case, records).items():
        points = [(r.seconds, abs(value(r, module.HEADLINE))) for r in members]
        told["series"].append({
            "label": label, "points": points, "front": front(points), "orders": orders(members, module.HEADLINE,
                                                                                       module.KNOB),
            "seconds_to_1_percent": seconds_to(GOAL, points)})
    return told


def number(value: float | None) -> float | None:
    """A value as JSON knows it."""
    return None if value is None or not np.isfinite(value) else float(value)


def finite(value: Any) -> Any:
    """A value of JSON whose numbers are all finite: null stands for the others."""
    if isinstance(value, dict):
        return {key: finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [finite(part) for part in value]
    return number(value) if isinstance(value, float) else value

"""`robosim report`: runs cases over their choices, one JSON line a run, so that error can be read against time."""

from pathlib import Path

from tqdm import tqdm

import mpm
from robosim.cases import NAMES, find
from robosim.cases.record import Record
from robosim.output import OutputFolder


def run_cases(names: list[str], out: Path) -> int:
    """Run cases (all when the list is empty) and append their lines to report.jsonl; returns 0."""
    cases = [find(name) for name in names or NAMES]
    folder = OutputFolder(out)
    lines = folder.path / "report.jsonl"
    mpm.init()
    runs = [(case, choices) for case in cases for choices in case.SWEEP]
    print(f"{'case':16} {'particles':>9} {'seconds':>9}  errors")
    for case, choices in tqdm(runs, unit="run", disable=None):
        record = case.measure(**choices)
        with lines.open("a") as file:  # a line is whole or not there: a killed sweep loses the run it was in
            file.write(record.line() + "\n")
        tqdm.write(_row(record, choices))
    print(f"one line a run in {lines}")
    return 0


def _row(record: Record, choices: dict) -> str:
    errors = ", ".join(f"{name} {value:.3g}" for name, value in record.errors.items())
    chosen = ", ".join(f"{name}={value}" for name, value in choices.items())
    return f"{record.case:16} {record.particles:9d} {record.seconds:9.3g}  {errors}  ({chosen})"

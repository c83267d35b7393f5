"""The table of a pipeline: each sub-task's scores from demonstration to sequence, and the whole arm's result."""

from pathlib import Path
from typing import Any

import mpm
from mpm import input_files
from policies.results.page import align_columns

ARM_COLUMNS = ("scooped_mass_kg", "delivered_fraction", "spilled_fraction")
RENAMED = {"scooped_mass": "scooped_mass_kg"}
"""Key of an earlier report.json -> its name now."""


def collect_rows(out: Path, tasks: list[str], training_folders: dict[str, Path]) -> list[dict[str, Any]]:
    """Return a row for each sub-task and a last one of the whole arm; None where a result is missing.

    demonstration: best score among the task's grains. learned: score of the best motion, replayed. grains, delivered,
    turned_deg, relative_turn_error: in the sequence of sub-tasks, each begun with what the one before has left.

    Raises:
        mpm.InvalidValue: a report.json of an earlier version.
    """
    sequence = {row["task"]: row for row in read_json(out / "chain" / "chain.json").get("sub_tasks", [])}
    rows = []
    for task in tasks:
        replayed = read_json(training_folders[task] / "status.json").get("replayed", {})
        result = sequence.get(task, {})
        result = result.get("from_previous", result.get("from_settled_start", {}))
        rows.append({"task": task, "demonstration": _best_demonstration(out / "demonstrations" / task),
                     "learned": replayed.get("tcs"), "grains": result.get("grains"),
                     "delivered": result.get("delivered"), "turned_deg": result.get("rotation_deg"),
                     "relative_turn_error": result.get("rotation_relative_error")})
    arm = read_arm_report(out / "arm" / "report.json")
    return [*rows, {"task": "whole arm", **{key: arm.get(key) for key in ARM_COLUMNS}}]


def _best_demonstration(folder: Path) -> float | None:
    demonstrations = read_json(folder / "demonstrations.json").get("demonstrations", [])
    return max((values["tcs"] for row in demonstrations for condition, values in row.items()
                if condition.startswith("among")), default=None)


def read_arm_report(path: Path) -> dict[str, Any]:
    """Return the whole arm's figures, {} without a file; raises mpm.InvalidValue for keys of an earlier version."""
    report = read_json(path)
    for old, new in RENAMED.items():
        if old in report:
            raise mpm.InvalidValue(f"{path}: key {old!r} is now called {new!r}; rename it, or remove the folder to run "
                                   f"the arm again")
    return report


def read_json(path: Path) -> dict[str, Any]:
    """Return the table of a JSON file, {} without a file; raises mpm.InvalidValue for a file that holds none."""
    stored = input_files.read_json(path) if path.is_file() else {}
    if not isinstance(stored, dict):
        raise mpm.InvalidValue(f"{path}: holds no table; remove it")
    return stored


def format_rows(rows: list[dict[str, Any]]) -> str:
    """Return the table as text."""
    def cell(value: Any, form: str) -> str:
        return "-" if value is None else form.format(value)

    lines = [["sub-task", "demonstration", "learned", "grains", "delivered", "turned [deg]", "turn error"]]
    lines += [[row["task"], cell(row["demonstration"], "{:.2f}"), cell(row["learned"], "{:.2f}"),
               cell(row["grains"], "{}"), cell(row["delivered"], "{:.3f}"), cell(row["turned_deg"], "{:.1f}"),
               cell(row["relative_turn_error"], "{:.1%}")] for row in rows[:-1]]
    arm = rows[-1]
    return (f"{align_columns(lines)}\nwhole arm: {cell(arm['scooped_mass_kg'], '{:.4f} kg')} scooped, "
            f"{cell(arm['delivered_fraction'], '{:.3f}')} delivered, {cell(arm['spilled_fraction'], '{:.3f}')} spilled")

"""The table of a pipeline: each sub-task's scores from demonstration to sequence, and the whole arm's result."""

from pathlib import Path
from typing import Any

from robosim.base.input_files import check_form, read_table
from robosim.base.output_folder import aligned

ARM_COLUMNS = ("scooped_mass_kg", "delivered_fraction", "spilled_fraction")
RESULT = dict.fromkeys(("grains", "delivered", "rotation_deg", "rotation_relative_error"), (float, None, ...))
EITHER = dict.fromkeys(("from_previous", "from_settled_start"), (RESULT, None, ...))
CHAIN = {"sub_tasks": ([{"task": str, **EITHER}], ...)}
STATUS = {"replayed": ({"tcs": (float, None, ...)}, None, ...)}
DEMONSTRATIONS = {"demonstrations": ([{str: object}], ...)}
"""Forms of chain.json, status.json and demonstrations.json, as far as they are read."""


def collect_rows(out: Path, tasks: list[str], training_folders: dict[str, Path]) -> list[dict[str, Any]]:
    """Return a row for each sub-task and a last one of the whole arm; None where a result is missing.
    demonstration: best score among the task's grains. recorded: score of the best motion, replayed. grains, delivered,
    turned_deg, relative_turn_error: in the sequence of sub-tasks, each begun with what the one before has left."""
    chain = read_table(out / "chain" / "chain.json", CHAIN)
    sequence = {row["task"]: row for row in chain.get("sub_tasks", [])}
    rows = []
    for task in tasks:
        demonstrations = out / "demonstrations" / task / "demonstrations.json"
        among = [values for row in read_table(demonstrations, DEMONSTRATIONS).get("demonstrations", [])
                 for condition, values in row.items() if condition.startswith("among")]
        check_form(among, [{"tcs": float}], str(demonstrations))
        replayed = read_table(training_folders[task] / "status.json", STATUS).get("replayed") or {}
        result = sequence.get(task, {})
        result = result.get("from_previous") or result.get("from_settled_start") or {}
        rows.append({"task": task, "demonstration": max((values["tcs"] for values in among), default=None),
                     "recorded": replayed.get("tcs"), "grains": result.get("grains"),
                     "delivered": result.get("delivered"), "turned_deg": result.get("rotation_deg"),
                     "relative_turn_error": result.get("rotation_relative_error")})
    arm = read_table(out / "arm" / "report.json", dict.fromkeys(ARM_COLUMNS, (float, None, ...)))
    return [*rows, {"task": "whole arm", **{key: arm.get(key) for key in ARM_COLUMNS}}]


def format_rows(rows: list[dict[str, Any]]) -> str:
    """Return the table as text."""
    def cell(value: Any, form: str) -> str:
        return "-" if value is None else form.format(value)

    lines = [["sub-task", "demonstration", "recorded", "grains", "delivered", "turned [deg]", "turn error"]]
    lines += [[row["task"], cell(row["demonstration"], "{:.2f}"), cell(row["recorded"], "{:.2f}"),
               cell(row["grains"], "{}"), cell(row["delivered"], "{:.3f}"), cell(row["turned_deg"], "{:.1f}"),
               cell(row["relative_turn_error"], "{:.1%}")] for row in rows[:-1]]
    arm = rows[-1]
    return (f"{aligned(lines)}\nwhole arm: {cell(arm['scooped_mass_kg'], '{:.4f} kg')} scooped, "
            f"{cell(arm['delivered_fraction'], '{:.3f}')} delivered, {cell(arm['spilled_fraction'], '{:.3f}')} spilled")

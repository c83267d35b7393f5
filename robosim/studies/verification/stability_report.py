"""`robosim stability`: stiff and extreme cases as a heat map, a table and JSON."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import mpm
from robosim.base.digests import code_digest
from robosim.base.jobs import Launcher
from robosim.base.output_folder import OutputFolder
from robosim.base.provenance import provenance
from robosim.base.study import Job, Study
from robosim.reports.page import HeatCell, Page
from robosim.studies.verification.runs import replace_non_finite
from robosim.studies.verification.stability import field
from robosim.studies.verification.stability.cell import DEFINITIONS, CellResult
from robosim.studies.verification.stability.field import AXES, find_axis

CELLS = "robosim.studies.verification.stability.field"
"""Module whose code the cells exercise."""


def stability(axes: list[str], out: Path, jobs: int = 1, launcher: Launcher | None = None) -> int:
    """Run the cells of axes, all when the list is empty, and write index.html and stability.json.
    Cells that the folder has from the same code are not run again. jobs: cells at a time, here; launcher: runs
    them elsewhere. Returns 0 if no cell is unstable, else 1. Raises UnknownName for an axis that does not exist."""
    cells = [Job("robosim.studies.verification.stability_report:run_cell", {"axis": axis, "value": value},
                 exercises=CELLS) for axis in axes or AXES for value in find_axis(axis)[1]]
    with OutputFolder(out) as folder:
        rows = Study(folder.path, jobs, launcher).rows(cells, "stability", "cells")
        results = [replace_non_finite(row.value) or asdict(CellResult(
            **row.job.arguments, verdict="unstable", reason=f"the process ended: {row.failed}")) for row in rows]
        folder.write_json("stability.json", {"made_by": provenance(), "code": code_digest(CELLS), "cells": results})
        folder.write_text("index.html", make_page(results).html())
    for result in results:
        print(f"{result['axis']:20} {result['value']!s:16} {result['verdict']:9} {result['reason']}")
    print(out / "index.html")
    return int(any(result["verdict"] == "unstable" for result in results))


def run_cell(axis: str, value: float | str) -> dict[str, Any]:
    """Run a cell; return its result."""
    mpm.init()
    return asdict(field.run_cell(axis, value))


def make_page(results: list[dict[str, Any]]) -> Page:
    """Make the page: heat map, definitions, table."""
    page = Page("Stability: stiff and extreme cases")
    counts = {kind: sum(r["verdict"] == kind for r in results) for kind in ("stable", "refused", "unstable")}
    page.add_text(", ".join(f"{n} {kind}" for kind, n in counts.items()) + ". Point at a cell for its readings.")
    rows: dict[str, list[HeatCell]] = {}
    for r in results:
        readings = "\n".join(f"{name} {value:.4g}" for name, value in r["readings"].items() if value is not None)
        rows.setdefault(r["axis"], []).append((str(r["value"]), r["verdict"], f"{r['reason']}\n{readings}".strip()))
    page.add_heat_map(rows)
    page.add_heading("Definition of stable")
    for subject, definition in DEFINITIONS.items():
        page.add_text(f"{subject}: {definition}.")
    page.add_heading("All cells")
    head = ("axis", "value", "verdict", "reason")
    page.add_table(head, [[r[key] for key in head] for r in results])
    return page

"""`robosim stability`: stiff and extreme cases as a heat map, a table and JSON."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from robosim.base.digests import code_digest
from robosim.base.errors import ConfigError
from robosim.base.input_files import check_form, read_json
from robosim.base.jobs import Runner, run_jobs
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.base.provenance import provenance
from robosim.reports.page import HeatCell, Page
from robosim.studies.verification.analysis import replace_non_finite
from robosim.studies.verification.runs import WORKER
from robosim.studies.verification.stability.cell import CellResult
from robosim.studies.verification.stability.field import AXES, find_axis

REPORT = {"code": str, "cells": [{"axis": str, "value": object, "verdict": str, "reason": str,
                                  "readings": {str: (float, None)}}]}
"""Form of stability.json."""
CELLS = "robosim.studies.verification.stability.field"
"""Module whose code the cells exercise."""
ENDED = "the process ended: "
"""Beginning of the reason of a cell whose process gave no result; such a cell is run again."""
DEFINITIONS = {
    "particles": "finite; every principal stretch between 0.05 and 20; no particle outside the walls; speeds below "
    "twice what the drop gives plus a tenth of the sound speed; energy never more than 1 % above the start's; momentum "
    "accounted for to 1e-5 of what was exchanged",
    "particles and bodies": "the same for both together; a body at rest within 0.3 mm of its height at MuJoCo steps of "
    "0.2 ms",
    "arm": "finite; motors within their torques; joints within their ranges to a degree; the tool within a millimetre "
    "of its target, without a joint faster than the data sheet allows",
}
"""What "stable" means for each subject."""


def stability(axes: list[str], out: Path, jobs: int = 1, runner: Runner | None = None) -> int:
    """Run the cells of axes, all when the list is empty, and write index.html and stability.json.

    Cells that the folder has from the same code are not run again. jobs: cells at a time, here; runner: runs
    them elsewhere.
    Returns 0 if no cell is unstable, else 1. Raises UnknownName for an axis that does not exist, ConfigError for a
    stability.json that is no stability report.
    """
    cells = [(axis, value) for axis in axes or AXES for value in find_axis(axis)[1]]
    with OutputFolder(out) as folder:
        code = code_digest(CELLS)
        known = {cell_key(r["axis"], r["value"]): r for r in read_results(folder.path / "stability.json", code)}
        waiting = [(axis, value) for axis, value in cells if cell_key(axis, value) not in known]
        work = [(WORKER, ("--cell", axis, json.dumps(value))) for axis, value in waiting]
        progress = Progress(initial=len(cells) - len(waiting), total=len(cells), desc="stability", unit="cells")
        for index, result, reason in run_jobs(work, jobs, runner):
            axis, value = waiting[index]
            ended = CellResult(axis, value, "unstable", f"{ENDED}{reason}")
            known[cell_key(axis, value)] = replace_non_finite(result) or asdict(ended)
            folder.write_json("stability.json", {"made_by": provenance(), "code": code, "cells": list(known.values())})
            progress.update()
        progress.close()
        results = [known[cell_key(*cell)] for cell in cells]
        folder.write_text("index.html", make_page(results).html())
    for result in results:
        print(f"{result['axis']:20} {result['value']!s:16} {result['verdict']:9} {result['reason']}")
    print(out / "index.html")
    return int(any(result["verdict"] == "unstable" for result in results))


def cell_key(axis: str, value: float | str) -> str:
    """Return a key that is the same for the same cell."""
    return json.dumps([axis, value])


def read_results(path: Path, code: str) -> list[dict[str, Any]]:
    """Read the results of an earlier run with the same code; none where there is no file.

    Raises ConfigError for a file that holds anything else, and leaves it unchanged.
    """
    if not path.is_file():
        return []
    try:
        content = read_json(path)
        check_form(content, REPORT)
        cells = content["cells"]
        check_form([cell["value"] for cell in cells if not isinstance(cell["value"], str)], [float], "value")
        return [cell for cell in cells if not cell["reason"].startswith(ENDED)] if content["code"] == code else []
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: not a stability report ({type(error).__name__}: {error}); it is left as it is: "
                          f"give another --out, or move the file away") from error


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
    page.add_table(["axis", "value", "verdict", "reason"],
                   [[r["axis"], r["value"], r["verdict"], r["reason"]] for r in results])
    return page

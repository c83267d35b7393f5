"""`robosim stability`: the matrix of stiff and extreme cases, as a heat map, a table and JSON."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from robosim.config.output import OutputFolder
from robosim.errors import ConfigError
from robosim.reports.jobs import run_jobs
from robosim.reports.page import Page
from robosim.reports.provenance import code_digest, provenance
from robosim.verification.analysis import finite
from robosim.verification.stability.cell import Verdict
from robosim.verification.stability.field import AXES, axis_named

ENDED = "the process ended: "
"""Begins the reason of a cell that gave no answer; such a cell is judged again."""
DEFINITIONS = {
    "grains": "finite; every principal stretch between 0.05 and 20; no grain outside the walls; speeds below twice "
    "what the drop gives plus a tenth of the sound speed; energy never more than 1 % above the start's; momentum "
    "accounted for to 1e-5 of what was exchanged",
    "grains and bodies": "the same of both together; a body at rest lies within 0.3 mm of where it does at MuJoCo "
    "steps of 0.2 ms",
    "arm": "finite; motors within their torques; joints within their ranges to a degree; the tool where it was asked "
    "to be within a millimetre, without a joint faster than the data sheet allows",
}


def stability(axes: list[str], out: Path, jobs: int = 1) -> int:
    """Judge the cells of the axes (all when the list is empty); returns 1 if one is unstable. Cells that the folder
    holds, judged by the same code, are not judged again."""
    cells = [(axis, value) for axis in axes or AXES for value in axis_named(axis)[1]]
    folder = OutputFolder(out)
    code = code_digest("robosim.verification.stability.field")
    known = {key(v["axis"], v["value"]): v for v in stored(folder.path / "stability.json", code)}
    waiting = [(axis, value) for axis, value in cells if key(axis, value) not in known]
    work = [("robosim.verification.run_one", ("--cell", axis, json.dumps(value))) for axis, value in waiting]
    progress = tqdm(initial=len(cells) - len(waiting), total=len(cells), unit="cell", file=sys.stderr)
    for place, found, failed in run_jobs(work, jobs):
        axis, value = waiting[place]
        ended = Verdict(axis, value, "unstable", f"{ENDED}{failed}")
        known[key(axis, value)] = finite(found) or asdict(ended)
        folder.write_json("stability.json", {"made_by": provenance(), "code": code, "cells": list(known.values())})
        progress.update()
    progress.close()
    verdicts = [known[key(*cell)] for cell in cells]
    folder.write("index.html", lambda path: path.write_text(drawn(verdicts).html()))
    for verdict in verdicts:
        print(f"{verdict['axis']:20} {verdict['value']!s:16} {verdict['verdict']:9} {verdict['reason']}")
    print(folder.path / "index.html")
    return int(any(verdict["verdict"] == "unstable" for verdict in verdicts))


def key(axis: str, value: float | str) -> str:
    """The same for the same cell."""
    return json.dumps([axis, value])


def stored(path: Path, code: str) -> list[dict[str, Any]]:
    """Cells that an earlier run judged with the same code; raises ConfigError for a file that is something else."""
    if not path.is_file():
        return []
    try:
        told = json.loads(path.read_text())
        cells = [cell for cell in told["cells"] if {"axis", "value", "verdict", "reason", "readings"} <= set(cell)]
        return [cell for cell in cells if not cell["reason"].startswith(ENDED)] if told["code"] == code else []
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: not a stability report ({type(error).__name__}: {error}); it is left as it is: "
                          f"give another --out, or move the file away") from error


def drawn(verdicts: list[dict[str, Any]]) -> Page:
    """The page: heat map first."""
    page = Page("Stiff and extreme cases")
    counts = {kind: sum(v["verdict"] == kind for v in verdicts) for kind in ("stable", "refused", "unstable")}
    page.add_text(", ".join(f"{n} {kind}" for kind, n in counts.items()) + ". Point at a cell for its readings.")
    rows: dict[str, list[tuple[str, str, str]]] = {}
    for v in verdicts:
        readings = "\n".join(f"{name} {value:.4g}" for name, value in v["readings"].items() if value is not None)
        rows.setdefault(v["axis"], []).append((str(v["value"]), v["verdict"], f"{v['reason']}\n{readings}".strip()))
    page.add_heat_map(rows)
    page.add_heading("What stable means")
    for what, words in DEFINITIONS.items():
        page.add_text(f"{what}: {words}.")
    page.add_heading("Every cell")
    page.add_table(["axis", "value", "verdict", "reason"],
               [[v["axis"], v["value"], v["verdict"], v["reason"]] for v in verdicts])
    return page

"""A rehearsal with the exact model, and several with errors of the model: the worst of every figure."""

import hashlib
import math
import sys
from pathlib import Path
from typing import Any

from robosim.base.input_files import read_json
from robosim.base.jobs import Launcher
from robosim.base.output_folder import OutputFolder
from robosim.base.study import Job, Study
from robosim.config.materials import load_material
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.metrics import Bound, get_bounds
from robosim.rehearsal.page import split_unit
from robosim.rehearsal.session import RunOptions, check_rehearsal, rehearse
from robosim.reports.page import Page

Rows = dict[int, dict[str, Any]]
"""Seed of the errors, 0 for the exact model -> report of that run."""


def perturb(name: str, out: Path, count: int, *, jobs: int = 1, launcher: Launcher | None = None,
            options: dict[str, Any] | None = None) -> int:
    """Run a rehearsal with the exact model and `count` times with drawn errors; write perturbed.json and index.html.
    options: further arguments of `rehearse`. jobs: runs at a time, here; launcher: runs them elsewhere. Runs that the
    folder has from the same code and configuration are not repeated. Returns 0 if every bound held in every run."""
    options = options or {}
    config = check_rehearsal(name, **{key: value for key, value in options.items() if key != "seed"})
    inputs = [config.model_dump(mode="json"), load_material(config.material).model_dump(mode="json"),
              {path.name: hashlib.sha256(path.read_bytes()).hexdigest()
               for path in sorted(Path(config.motions).glob("*.npz"))} if config.motions else {}]
    with OutputFolder(out) as folder:
        work = [Job("robosim.studies.robustness.perturbed_runs:run_with_errors",
                    {"name": name, "seed": seed, "options": options}, depends=inputs,
                    places={"out": str(run_folder(folder.path, seed))}) for seed in range(count + 1)]
        done = Study(folder.path, jobs, launcher).rows(work, "runs")
        rows = {seed: row.value for seed, row in enumerate(done) if not row.failed}
        failed = {seed: row.failed for seed, row in enumerate(done) if row.failed}
        folder.failures += failed.values()
        folder.write_json("perturbed.json", {"rows": {str(seed): row for seed, row in rows.items()}})
        page, holds = make_page(config, rows, failed)
        folder.write_text("index.html", page.html())
    for seed, reason in failed.items():
        print(f"no result with errors {seed}: {reason}; run the same command again to continue", file=sys.stderr)
    print(f"{verdict(rows, failed)}\n{out / 'index.html'}")
    return int(not holds)


def run_with_errors(name: str, seed: int, options: dict[str, Any], out: str) -> dict[str, Any]:
    """Run a rehearsal with errors of the model, none for seed 0; return its report."""
    chosen: dict[str, Any] = options | ({"motions": Path(options["motions"])} if "motions" in options else {})
    rehearse(name, Path(out), RunOptions(seed=chosen.pop("seed", 0), model_errors=seed or None), **chosen)
    return read_json(Path(out) / "report.json")


def run_folder(out: Path, seed: int) -> Path:
    """Return the folder of a run."""
    return out / ("exact" if seed == 0 else f"errors_{seed}")


def verdict(rows: Rows, failed: dict[int, str]) -> str:
    """Return in words how many runs held every bound."""
    drawn = [row for seed, row in rows.items() if seed]
    missed = sum(bool(row["missed"]) for row in drawn)
    with_errors = f"missed in {missed} of {len(drawn)} runs with errors"
    if 0 not in rows:
        text = f"no result with the exact model; {with_errors}"
    elif rows[0]["missed"]:
        text = f"missed with the exact model; {with_errors}"
    elif missed:
        text = f"holds only with the exact model: {with_errors}"
    elif not drawn:
        text = "held with the exact model; no result with errors"
    else:
        every = len(rows) + len(failed)
        text = f"every bound held in {len(rows)} of {every} runs, with the exact model and with errors"
    return text + (f"; {len(failed)} without a result" if failed else "")


def find_worst(rows: Rows, name: str, bound: Bound) -> tuple[float | None, int]:
    """Return the largest value of a figure, or the smallest of one that has no upper bound, and the seed of its run.
    A figure that a run could not have is worse than any value."""
    def excess(value: object) -> float:
        if not isinstance(value, int | float):
            return math.inf
        return value if math.isfinite(bound.high) else -value

    seed = max(rows, key=lambda one: excess(rows[one].get(name)))
    value = rows[seed].get(name)
    return (value if isinstance(value, int | float) else None), seed


def make_page(config: RehearsalConfig, rows: Rows, failed: dict[int, str]) -> tuple[Page, bool]:
    """Return the page of runs, and whether every bound held in all of them."""
    holds = bool(rows) and not failed and not any(row["missed"] for row in rows.values())
    page = Page(f"{config.description}: {config.material}, with errors of the model")
    page.set_verdict(verdict(rows, failed), holds=holds)
    page.add_heading("Worst of every figure")
    table = []
    for name, bound in get_bounds(config).items():
        if rows:
            worst, seed = find_worst(rows, name, bound)
            is_missed = any(line.startswith(f"{name} ") for row in rows.values() for line in row["missed"])
            words, unit = split_unit(name)
            table.append([words, unit, rows.get(0, {}).get(name), worst, run_folder(Path(), seed).name,
                          *(end if math.isfinite(end) else None for end in bound),
                          "missed" if is_missed else "held"])
    page.add_table(["figure", "unit", "exact model", "worst", "run", "accepted from", "to", "verdict"], table)
    page.add_heading("Runs")
    errors = {seed: row.get("model_errors") or {} for seed, row in rows.items()}
    names = list(dict.fromkeys(name for drawn in errors.values() for name in drawn))
    page.add_table(["run", "verdict", *names, "missed"],
                   [[run_folder(Path(), seed).name, "missed" if row["missed"] else "held",
                     *(shorten(errors[seed].get(name)) for name in names), "; ".join(row["missed"])]
                    for seed, row in rows.items()])
    page.add_text("Each run has a folder of its own, with a page.")
    return page, holds


def shorten(value: object) -> object:
    """Return a list of numbers as text."""
    return ", ".join(f"{one:.3g}" for one in value) if isinstance(value, list) else value

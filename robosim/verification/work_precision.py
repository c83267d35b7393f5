"""`robosim report`: cases with known answers, error against run time, as a page, JSON and JSON lines."""

import json
import re
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from robosim.config.output import OutputFolder
from robosim.errors import ConfigError
from robosim.reports.page import Page
from robosim.reports.plot import Plot
from robosim.reports.provenance import provenance
from robosim.verification.analysis import analysed, finite, front, series
from robosim.verification.cases import NAMES, find
from robosim.verification.cases.criteria import Within, told, value
from robosim.verification.compare import compared
from robosim.verification.results import Run, carried_out, planned

YARDSTICK = "reference_layout.py"
"""Script whose nanoseconds per grain and substep tell how fast a machine is."""


def report(names: list[str], out: Path, *, quick: bool = False, jobs: int = 1, points: Path | None = None,
           yardsticks: Path | None = None, compare: Path | None = None) -> int:
    """Run cases (all when the list is empty) and write what they amount to; returns 1 where a claim failed."""
    for name in names:
        find(name)
    if jobs < 1:
        raise ConfigError(f"--jobs {jobs}; accepted: 1 or more")
    others = peers(points) if points else None
    older = stored(compare) if compare else None
    folder = OutputFolder(out)
    runs = carried_out(planned(names or list(NAMES), quick), folder.path / "report.jsonl", jobs)
    speed = measured(yardsticks) if yardsticks else None
    results = {name: analysed(name, [run for run in runs if run.case == name]) for name in names or NAMES}
    whole = finite({"made_by": provenance(), "yardstick_ns": speed, "cases": results,
                    "runs": [asdict(run) for run in runs]})
    folder.write_json("report.json", whole)
    page = drawn(results, runs, others, speed)
    if older is not None:
        compared(page, older, whole)
    folder.write("index.html", lambda path: path.write_text(page.html()))
    return summed_up(results, folder.path, quick)


def summed_up(results: dict[str, Any], path: Path, quick: bool) -> int:
    """Say what came out; 1 where a claim failed or a run did, or where a whole report leaves a claim untold."""
    bad = 0
    for name, result in results.items():
        verdicts = [claim["verdict"] for claim in result["claims"]]
        print(f"{name:18} {verdicts.count('pass')} passed, {verdicts.count('fail')} failed, "
              f"{verdicts.count('not run')} not run")
        for claim in result["claims"]:
            if claim["verdict"] == "fail":
                print(f"  fail: {claim['claim']}: {claim['found']}; accepted {claim['low']} to {claim['high']}")
        for failed in result["failed"]:
            print(f"  no result: {told(failed['choices'])}: {failed['reason']}")
        bad += verdicts.count("fail") + len(result["failed"]) + (0 if quick else verdicts.count("not run"))
    print(path / "index.html")
    return int(bad > 0)


def drawn(results: dict[str, Any], runs: list[Run], others: dict[str, Any] | None, speed: float | None) -> Page:
    """The page."""
    page = Page("Error against run time")
    page.add_heading("Claims")
    page.add_table(["case", "claim", "found", "from", "to", "verdict"],
               [[name, c["claim"], c["found"], c["low"], c["high"], c["verdict"]] for name, result in results.items()
                for c in result["claims"]])
    for name, result in results.items():
        page.add_heading(name)
        page.add_text(f"Reference: {result['source']}")
        records = [run.record for run in runs if run.case == name and run.record is not None]
        if records:
            page.add_plot(diagram(name, records, others, speed), "Seconds after compilation, on one core.")
            rows = []
            for one in result["series"]:
                rows.append([one["label"], len(one["points"]), ", ".join(f"{o:.2f}" for o in one["orders"]),
                             one["seconds_to_1_percent"], min(p[1] for p in one["points"])])
            page.add_table(["series", "runs", "observed orders", "seconds to 1 %", f"least {result['headline']}"], rows)
            keys = sorted({key for r in records for key in r.choices})
            errors = sorted({key for r in records for key in r.errors})
            page.add_table([*keys, "grains", "steps", "seconds", "compiling [s]", "memory [MB]", *errors],
                       [[*(str(r.choices.get(key, "")) if not isinstance(r.choices.get(key), float)
                           else r.choices[key] for key in keys), r.particles, r.steps, r.seconds, r.compile_seconds,
                         r.peak_bytes / 1e6, *(r.errors.get(key) for key in errors)] for r in records])
        for failed in result["failed"]:
            page.add_text(f"No result at {told(failed['choices'])}: {failed['reason']}")
    return page


def diagram(name: str, records: list, others: dict[str, Any] | None, speed: float | None) -> str:
    """Error against seconds of one case."""
    module = find(name)
    plot = Plot(name.replace("_", " "), "seconds", f"error ({module.HEADLINE})")
    everything = []
    for label, members in series(name, records).items():
        points = [(r.seconds, max(abs(value(r, module.HEADLINE)), 1e-17)) for r in members]
        words = [f"{told(r.choices)}\n{r.particles} grains, {r.steps} steps\n{r.seconds:.3g} s, "
                 f"{module.HEADLINE} {value(r, module.HEADLINE):.3g}" for r in members]
        plot.add_series(points, words, label)
        everything += points
    plot.add_front([everything[k] for k in front(everything)])
    if name == "column_collapse" and others is not None:
        draw_peers(plot, others, speed)
    bounds = [check.high for check in module.CHECKS if isinstance(check, Within) and check.name == module.HEADLINE
              and check.high > 0]
    if bounds:
        plot.add_band(min(bounds))
    return plot.svg()


def draw_peers(plot: Plot, others: dict[str, Any], speed: float | None) -> None:
    """Points of other codes on the column, their seconds as they would be on this machine."""
    theirs = re.search(r"=\s*([0-9.]+) ns", others.get("machine", ""))
    factor = speed / float(theirs[1]) if speed and theirs else 1.0
    rim = float(others["reference"]["r_final_m"])
    by_code: dict[str, list] = {}
    for point in others["points"]:
        by_code.setdefault(point["code"], []).append(point)
    for code, points in by_code.items():
        places = [(p["seconds"] * factor, abs(p["r99_m"] / rim - 1)) for p in points]
        words = [f"{code}\ncell {p['cell_m']} m, {p['particles']} grains, {p.get('cores', 1)} cores\n"
                 f"{p['seconds']} s there, {p['seconds'] * factor:.3g} s here" for p in points]
        plot.add_series(places, words, code + (" (seconds of another machine)" if factor == 1.0 else ""), joined=False)


def peers(path: Path) -> dict[str, Any]:
    """A file with other codes' points; raises ConfigError for what is none."""
    told = stored(path)
    try:
        float(told["reference"]["r_final_m"])
        assert all({"code", "cell_m", "seconds", "r99_m", "particles"} <= set(p) for p in told["points"])
    except (KeyError, TypeError, ValueError, AssertionError) as error:
        raise ConfigError(f"--points {path}: accepted: reference.r_final_m, and points with code, cell_m, particles, "
                          f"seconds, r99_m") from error
    return told


def stored(path: Path) -> Any:
    """A JSON file; raises ConfigError."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be read as JSON: {error}; it is left as it is") from error


def measured(folder: Path) -> float:
    """Nanoseconds per grain and substep of the yardstick on this machine, now."""
    script = folder / YARDSTICK
    if not script.is_file():
        raise ConfigError(f"--yardsticks {folder}: no {YARDSTICK} in it")
    said = subprocess.run([sys.executable, str(script), "50000"], capture_output=True, text=True, check=False).stdout
    found = re.search(r'"ns_per_particle_substep": ([0-9.]+)', said)
    if found is None:
        raise ConfigError(f"{script}: says no ns_per_particle_substep")
    return float(found[1])

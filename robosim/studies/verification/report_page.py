"""Page of `robosim report`: expectations, error against run time, and a comparison with an earlier report."""

import base64
import json
import math
from typing import Any

from robosim.base.errors import ConfigError
from robosim.base.input_files import check_form
from robosim.reports.page import Page
from robosim.reports.plot import Plot
from robosim.studies.verification.cases import find
from robosim.studies.verification.cases.case import Comparison, Record, describe, select, value_of
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.runs import VERDICTS, Run, group_series, pareto_front, picture_of

REPORT = {"made_by": {"commit": object, "machine": object}, "runs": [{
    "case": str, "choices": {str: object}, "failed": (str, None, ...), "record": ({
        "seconds": (float, None), "errors": {str: (float, None)}}, None)}]}
"""Form of report.json, as far as reports are compared."""
PEERS_CASE, PEERS_ERROR = "collapse_profile", "rim of 99 %"
"""Case and error with which other codes' results are drawn."""
NOTABLE = 1.05
"""Ratio of errors or seconds from which a change is listed."""


def make_page(results: dict[str, Any], runs: list[Run], peers: dict[str, Any] | None) -> Page:
    """Make the page.
    results: case -> its part of report.json. peers: other codes' results on the column collapse."""
    page = Page("Verification: error against run time")
    page.add_heading("Cases")
    page.add_text(f"Errors are relative, unless they have a unit. {VERDICTS}")
    page.add_table(["case", "main error", "least", "largest", "unit", "verdict"], [
        [name, result["headline"], *result["range"], result["unit"], result["verdict"]]
        for name, result in results.items()])
    page.add_heading("Expectations")
    page.add_table(["case", "expectation", "found", "from", "to", "unit", "verdict"], [
        [name, *(c[key] for key in ("claim", "found", "low", "high", "unit", "verdict"))]
        for name, result in results.items() for c in result["claims"]])
    for name, result in results.items():
        page.add_heading(name)
        page.add_text(f"Reference: {result['source']}")
        records = [run.record for run in runs if run.case == name and run.record is not None]
        if records:
            if picture := picture_of(records):
                page.add_picture(base64.b64decode(picture), "A section through the scene at the end of a run: grains, "
                                                            "colliders in grey.")
            page.add_plot(draw_case(name, records, peers), "Seconds after compilation, on one core.")
            page.add_table(["series", "runs", "observed orders", "seconds to 1 %", f"least {result['headline']}"],
                           [[one["label"], len(one["points"]), ", ".join(f"{o:.2f}" for o in one["orders"]),
                             one["seconds_to_1_percent"], min(p[1] for p in one["points"])]
                            for one in result["series"]])
            for comparison in find(name).compare(records):
                kind = "relative" if comparison.is_relative else "absolute"
                page.add_plot(draw_comparison(comparison), f"Reference: {comparison.source or result['source']}. Its "
                              f"uncertainty: {comparison.uncertainty:g}, {kind}.")
            _add_runs(page, records)
        for failed in result["failed"]:
            page.add_text(f"No result at {describe(failed['choices'])}: {failed['reason']}")
    return page


def draw_comparison(comparison: Comparison) -> str:
    """Draw measured points beside reference data and its uncertainty; return it as HTML."""
    plot = Plot(comparison.title, comparison.x, comparison.y, logarithmic=comparison.is_logarithmic)
    for joined, series in ((comparison.is_joined, comparison.measured), (True, comparison.published)):
        for label, points in series.items():
            drawn = [point for point in points if math.isfinite(point[0]) and math.isfinite(point[1])]
            if drawn:
                plot.add_series([(x, y) for x, y, _ in drawn], [f"{text}\n{x:.4g}, {y:.4g}" for x, y, text in drawn],
                                label, joined=joined)
    if comparison.line:
        plot.add_line(comparison.line, comparison.uncertainty, is_relative=comparison.is_relative)
    return plot.html()


def _add_runs(page: Page, records: list[Record]) -> None:
    keys = sorted({key for r in records for key in r.choices})
    errors = sorted({key for r in records for key in r.errors})
    choices = [[value if isinstance(value, float) else str(value) for value in (r.choices.get(key, "") for key in keys)]
               for r in records]
    page.add_table([*keys, "particles", "steps", "seconds", "compilation [s]", "memory [MB]", *errors],
                   [[*chosen, r.particles, r.steps, r.seconds, r.compile_seconds, r.peak_bytes / 1e6,
                     *(r.errors.get(key) for key in errors)] for chosen, r in zip(choices, records)])


def draw_case(name: str, records: list[Record], peers: dict[str, Any] | None) -> str:
    """Draw a case's main error against seconds; return it as HTML."""
    case, peers = find(name), peers if name == PEERS_CASE else None
    drawn = PEERS_ERROR if peers else case.main_error
    plot = Plot(name.replace("_", " "), "seconds", f"error ({drawn})")
    all_points = []
    for label, members in group_series(name, records).items():
        points = [(r.seconds, max(abs(value_of(r, drawn)), 1e-17)) for r in members]
        tooltips = [f"{describe(r.choices)}\n{r.particles} particles, {r.steps} steps\n{r.seconds:.3g} s, "
                    f"{drawn} {value_of(r, drawn):.3g}" for r in members]
        plot.add_series(points, tooltips, label)
        all_points += points
    plot.add_front([all_points[k] for k in pareto_front(all_points)])
    if peers:
        draw_peers(plot, peers)
    for one in case.expectations:
        if isinstance(one, Within) and one.name == drawn and one.high > 0 \
                and select(records, one.where):  # one of f64 says nothing about runs of f32
            plot.add_band(one.high, f" at {describe(one.where)}" if one.where else "")
    return plot.html()


def draw_peers(plot: Plot, peers: dict[str, Any]) -> None:
    """Draw other codes' results on the column collapse, with the seconds that they took on their own machine."""
    rim = float(peers["reference"]["r_final_m"])
    by_code: dict[str, list] = {}
    for point in peers["points"]:
        by_code.setdefault(point["code"], []).append(point)
    for code, points in by_code.items():
        places = [(p["seconds"], abs(p["r99_m"] / rim - 1)) for p in points]
        tooltips = [f"{code}\ncell {p['cell_m']} m, {p['particles']} particles, {p.get('cores', 1)} cores\n"
                    f"{p['seconds']} s on its machine" for p in points]
        plot.add_series(places, tooltips, f"{code} (seconds of another machine)", joined=False)


def add_comparison(page: Page, old: dict[str, Any], new: dict[str, Any]) -> list[list[object]]:
    """Add the changed runs to a page, largest change of the error first; return the table's rows.
    old, new: contents of report.json. Raises ConfigError where the old one is no report."""
    try:
        check_form(old, REPORT)
        before = {run_key(run): (run["record"], run.get("failed")) for run in old["runs"]}
        origin = f"{old['made_by']['commit']} on {old['made_by']['machine']}"
    except (ValueError, KeyError) as error:
        raise ConfigError(f"--compare: not a report ({error}); accepted: a report.json of `robosim report`") from error
    rows: list[list[object]] = []
    for run in new["runs"]:
        (earlier, reason), now = before.get(run_key(run), (None, None)), run["record"]
        name = [run["case"], describe(run["choices"])]
        if earlier is not None and now is None:
            rows.append([*name, f"no result: {run['failed']}", *[None] * 2, math.inf, *[None] * 3])
        elif now is not None and earlier is None and reason:
            rows.append([*name, f"a result where there was none: {reason}", *[None] * 2, 0.0, *[None] * 3])
        if earlier is None or now is None:
            continue
        for key in sorted(set(earlier["errors"]) & set(now["errors"])):
            error = error_ratio(now["errors"][key], earlier["errors"][key])
            seconds = error_ratio(now["seconds"], earlier["seconds"])
            if max(magnitude(error), magnitude(seconds)) > math.log(NOTABLE):
                rows.append([*name, key, earlier["errors"][key], now["errors"][key], error,
                             earlier["seconds"], now["seconds"], seconds])
    rows.sort(key=lambda row: -magnitude(float(str(row[5]))))
    page.add_heading("Comparison with an earlier report")
    page.add_text(f"Before: {origin}. The table lists runs whose error or seconds changed by more than "
                  f"{NOTABLE - 1:.0%}; a ratio below 1 is an improvement.")
    page.add_table(["case", "choices", "error", "before", "now", "ratio", "seconds before", "seconds now",
                    "ratio of seconds"], rows)
    return rows


def run_key(run: dict[str, Any]) -> str:
    """Return a key that is the same for the same case and choices."""
    return json.dumps([run["case"], run["choices"]], sort_keys=True)


def magnitude(ratio: float) -> float:
    """Return |log ratio|, which is the same for half and for twice."""
    return abs(math.log(ratio)) if ratio > 0.0 else math.inf


def error_ratio(new: float | None, old: float | None) -> float:
    """Return |new| / |old|; 1 where both are zero, infinity where only the new one is not a number."""
    if new is None or old is None:
        return math.inf if new is None and old is not None else 1.0
    tiny = 1e-15
    return max(abs(new), tiny) / max(abs(old), tiny)

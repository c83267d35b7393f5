"""The page of a training run: verdict, learning curves, evaluations and configuration."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from policies.results.curves import MAX_ROWS_BYTES, read_rows
from robosim.base.files import write_text
from robosim.base.input_files import read_json, read_text
from robosim.reports.page import Page

AVERAGED = 10
"""Episodes over which a curve is averaged."""
NAMES = {"tcs": "score", "is_success": "success"}
"""Column -> its name in the page."""
DETAILS = ("preset", "demonstrations", "command", "commit", "code", "process", "label")
"""Entries of the manifest that are folded away, or are in the page's header."""
Curve = tuple[list[float], list[float]]


def write_run_page(out: Path) -> Path | None:
    """Write index.html into the folder of a run, finished or not; None where there is no run."""
    if not (out / "manifest.json").is_file() or not (out / "status.json").is_file():
        return None
    manifest, status = read_json(out / "manifest.json"), read_json(out / "status.json")
    episodes, evaluations = (read_rows(out / name) for name in ("episodes.csv", "evaluations.csv"))
    origin = {key: manifest[key] for key in ("command", "commit") if manifest.get(key)}
    page = Page(f"{manifest['method']} on {manifest['task']}, seed {manifest['seed']}", origin)
    verdict, holds = judge(status, len(episodes))
    page.set_verdict(verdict, holds=holds)
    figures = {name: {"episode": column(episodes, key), f"mean of {AVERAGED}": average(*column(episodes, key)),
                      "without exploration": column(evaluations, key)}
               for name, key in (("score", "tcs"), ("return", "return"))}
    figures[f"share of the grains, mean of {AVERAGED}"] = {
        key: average(*column(episodes, key)) for key in ("delivered", "spilled", "retained")}
    figures["time of an episode [s]"] = {"simulation": column(episodes, "simulating"),
                                         "updates": column(episodes, "updating")}
    charts = {title: shown for title, curves in figures.items()
              if (shown := {name: curve for name, curve in curves.items() if curve[0]})}
    if charts:
        page.add_heading("Learning curves")
        page.add_curves(charts, "episode", "A click in the legend hides a curve.")
    page.add_heading("Evaluations without exploration")
    page.add_table([NAMES.get(key, key) for key in evaluations[0]] if evaluations else [],
                   [[number(value) for value in row.values()] for row in evaluations])
    page.add_heading("Run")
    page.add_table(["entry", "value"], [[key, value] for key, value in [*manifest.items(), *status.items()]
                              if isinstance(value, str | int | float) and key not in DETAILS])
    page.add_details("Method", json.dumps(manifest.get("preset"), indent=2))
    if episodes:
        page.add_details("Episodes", read_text(out / "episodes.csv", MAX_ROWS_BYTES))
    if "-v" not in manifest["task"]:  # a sub-task of ours
        page.add_text(f"The best policy in other starts and materials: robosim evaluate {manifest['task']} "
                      f"--policy {out} --suite wide --out out/wide")
    write_text(out / "index.html", page.html())
    return out / "index.html"


def judge(status: dict[str, Any], count: int) -> tuple[str, bool]:
    """Return the verdict of a run's status, and whether it is good; count: episodes that ended."""
    state, best = status.get("state"), (status.get("evaluated") or {}).get("best")
    if state != "finished":
        return f"{state} after {count} episodes: {status.get('reason') or 'not finished'}", False
    if best is None:
        return f"finished after {count} episodes: {status.get('reason', '')}", True
    score = f"score {best['tcs']:.2f}" if "tcs" in best else f"return {best['return']:.2f}"
    succeeded = "" if "is_success" not in best else \
        f", {best['is_success']:.0%} of evaluated episodes succeeded"
    return (f"best policy without exploration: {score}{succeeded}; {count} episodes in "
            f"{status.get('seconds', 0.0) / 60.0:.1f} min"), best.get("is_success", 1.0) == 1.0


def column(rows: list[dict[str, str]], key: str) -> Curve:
    """Return episodes and values of a column where it has a number."""
    pairs = [(float(row["episode"]), float(row[key])) for row in rows if row.get(key) and row.get("episode")]
    return [x for x, _ in pairs], [y for _, y in pairs]


def average(x: list[float], y: list[float]) -> Curve:
    """Return means over AVERAGED values, each at the last of them."""
    n = min(AVERAGED, len(y))
    if not n:
        return [], []
    return x[n - 1 :], np.convolve(y, np.ones(n) / n, mode="valid").tolist()


def number(text: str) -> float | str:
    """Return a text's number, or the text."""
    try:
        return float(text)
    except ValueError:
        return text

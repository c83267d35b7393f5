"""Pages of training runs and of demonstrations: verdict, curves, scores, films, configuration."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from mpm.array_files import read_arrays
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
MOST_FILMS = 4
"""Films that are put into the page of demonstrations; the others stay files."""
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


def write_demonstration_page(out: Path) -> Path | None:
    """Write index.html into a folder of demonstrations; None where there are none."""
    if not (out / "demonstrations.json").is_file():
        return None
    stored = read_json(out / "demonstrations.json")
    rows = stored["demonstrations"]
    scores = [{name: values for name, values in row.items() if isinstance(values, dict) and "tcs" in values}
              for row in rows]
    own = next((name for name in scores[0] if name.startswith("among grains")), next(iter(scores[0])))
    page = Page(f"Demonstrations of {stored['task']}, {stored['method']} in {stored['material']}")
    succeeded = sum(bool(values[own]["is_success"]) for values in scores)
    page.set_verdict(f"{succeeded} of {len(rows)} succeed {own}, mean score "
                     f"{np.mean([values[own]['tcs'] for values in scores]):.2f}", holds=succeeded == len(rows))
    for row in rows[:MOST_FILMS]:
        film = (out / row["demonstration"]).with_suffix(".mp4")
        if film.is_file():
            page.add_film(film.read_bytes(), f"{row['demonstration']}, {own}")
    page.add_heading("Search")
    arrays = {row["demonstration"]: read_arrays(out / row["demonstration"]) for row in rows}
    losses = {name: curve(stored["losses"]) for name, stored in arrays.items()}
    norms = {name: curve(np.maximum(stored["norms"][:, 0], 1e-30)) for name, stored in arrays.items()
             if stored["norms"].size}
    page.add_curves({"loss": losses}, "iteration", "Of every iteration; the best one is kept.")
    if norms:
        page.add_curves({"|d loss / d positions| [1/m]": norms}, "step of the rollout",
                        "Derivatives before each step, of the best iteration.", is_logarithmic=True)
    page.add_heading("Scores")
    page.add_table(["demonstration", "seed", "loss", "iterations", "condition", "score", "success", "delivered",
                    "spilled", "retained"],
                   [[row["demonstration"], row["start"]["seed"], row["loss"], row["iterations"], condition,
                     v["tcs"], "pass" if v["is_success"] else "fail", v["delivered"], v["spilled"], v["retained"]]
                    for row, values in zip(rows, scores) for condition, v in values.items()])
    page.add_heading("Derivatives along the gradient, and by differences")
    page.add_table(["demonstration", "gradient", "differences"],
                   [[row["demonstration"], *pair] for row in rows for pair in row["check"]])
    demands = [row for row in rows if isinstance(row.get("arm demands"), dict)]
    if demands:
        page.add_heading("What the motions demand of the arm")
        names = list(demands[0]["arm demands"])
        page.add_table(["demonstration", *names],
                       [[row["demonstration"], *row["arm demands"].values()] for row in demands])
    write_text(out / "index.html", page.html())
    return out / "index.html"


def curve(values: np.ndarray) -> Curve:
    """Return values over their number."""
    return list(range(len(values))), np.asarray(values, float).tolist()

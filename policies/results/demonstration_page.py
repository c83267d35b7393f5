"""The page of demonstrations: verdict, films, losses, derivatives and scores."""

from pathlib import Path

import numpy as np

from mpm.array_files import read_arrays
from robosim.base.files import write_text
from robosim.base.input_files import read_json
from robosim.reports.page import Page

MOST_FILMS = 4
"""Films that are put into the page; the others stay files."""


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


def curve(values: np.ndarray) -> tuple[list[float], list[float]]:
    """Return values over their number."""
    return list(range(len(values))), np.asarray(values, float).tolist()

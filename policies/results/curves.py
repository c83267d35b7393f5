"""Learning curves: the score over the episodes of runs, as a picture."""

import csv
from collections import defaultdict
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from policies.results.summary import name_lines
from robosim.base.input_files import read_text

POINT = 10
"""Episodes of which a point of a curve is the mean."""
MAX_ROWS_BYTES = 200_000_000


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file; none where there is no file."""
    return list(csv.DictReader(read_text(path, MAX_ROWS_BYTES).splitlines())) if path.is_file() else []


def read_curve(path: Path) -> list[float] | None:
    """Return the mean score of every ten episodes of an episodes.csv; None where it has no scores, or is not there.
    Raises OSError, ValueError for a file that cannot be read."""
    scores = [float(row["tcs"]) for row in read_rows(path) if row.get("tcs")]
    return [round(float(np.mean(scores[k : k + POINT])), 2) for k in range(0, len(scores), POINT)] or None


def group_curves(rows: list[dict[str, Any]]) -> dict[str, dict[str, list[list[float]]]]:
    """Return the curves of runs by task and line of the tables; rows without a curve are left out."""
    groups: dict[str, dict[str, list[list[float]]]] = defaultdict(lambda: defaultdict(list))
    for line, row in zip(name_lines(rows), rows):
        if row["curve"]:
            groups[row["task"]][line].append(row["curve"])
    return {task: dict(sorted(lines.items())) for task, lines in sorted(groups.items())}


def draw_curves(file: Any, groups: dict[str, dict[str, list[list[float]]]], kind: str = "png") -> None:
    """Draw a panel a task: the median of each line's runs, and the band from their worst to their best.
    file: path, or a file that is open for writing. kind: "png" or "svg"."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt  # the backend comes first
    from matplotlib.lines import Line2D

    columns = min(3, len(groups))
    rows = -(-len(groups) // columns)
    figure, panels = plt.subplots(rows, columns, figsize=(4.6 * columns, 3.2 * rows + 0.6), squeeze=False,
                                  layout="constrained")
    names = sorted({line for lines in groups.values() for line in lines})
    colours = {name: plt.get_cmap("tab20" if len(names) > 10 else "tab10")(k) for k, name in enumerate(names)}
    for axes, (task, lines) in zip(panels.flat, groups.items()):
        for line, curves in lines.items():
            values = np.array([curve[: min(map(len, curves))] for curve in curves])
            episodes = POINT * (np.arange(values.shape[1]) + 1)
            axes.plot(episodes, np.median(values, 0), color=colours[line], lw=1.6)
            axes.fill_between(episodes, values.min(0), values.max(0), color=colours[line], alpha=0.12, lw=0)
        axes.set(title=task, xlabel="episode", ylabel="score, mean of ten episodes")
    for axes in list(panels.flat)[len(groups) :]:
        axes.axis("off")
    figure.legend([Line2D([], [], color=colours[name]) for name in names], names, loc="outside lower center",
                  ncols=min(4, len(names)), frameon=False)
    figure.savefig(file, format=kind, dpi=120, metadata={"Date": None} if kind == "svg" else None)
    plt.close(figure)

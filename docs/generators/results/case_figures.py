"""Figures of verification cases: a section through the scene, runs beside reference data, error against run time."""

import base64
import io
import math
from typing import Any

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.image import imread
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from generators.figures import GREY, STYLE
from robosim.studies.verification.cases import find
from robosim.studies.verification.cases.case import Comparison, Record
from robosim.studies.verification.runs import group_series, picture_of

PANEL = 3.1
"""Edge of a panel [inches]."""
MOST, PLOTS = 8, 3
"""Series that a panel names; comparisons that a figure shows."""


def figure_of(name: str, records: list[Record]) -> str:
    """An SVG of what there is to show of a case, in one row; empty where there are no runs."""
    if not records:
        return ""
    case, picture = find(name), picture_of(records)
    comparisons = case.compare(records)[:PLOTS]
    count = bool(picture) + len(comparisons) + 1
    style: Any = {**STYLE, "font.size": 8, "legend.fontsize": 6, "legend.frameon": False}
    with mpl.rc_context(style):
        figure, row = plt.subplots(1, count, figsize=(PANEL * count, PANEL), layout="constrained", squeeze=False)
        axes = list(row[0])
        if picture:
            show_scene(axes.pop(0), picture)
        for comparison in comparisons:
            draw_comparison(axes.pop(0), comparison)
        draw_errors(axes.pop(0), name, records)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
        plt.close(figure)
    return text.getvalue()


def show_scene(axes: Axes, picture: str) -> None:
    """The section through the scene at the end of a run."""
    axes.imshow(imread(io.BytesIO(base64.b64decode(picture)), format="png"))
    axes.set_title("the scene at the end", fontsize=8)
    axes.set_axis_off()


def draw_comparison(axes: Axes, comparison: Comparison) -> None:
    """Points of runs in colours, beside those of the reference in black with its uncertainty."""
    for place, (label, points) in enumerate(comparison.measured.items()):
        drawn = sorted((x, y) for x, y, _ in points if math.isfinite(x) and math.isfinite(y))
        axes.plot(*zip(*drawn), "-" if comparison.is_joined else "o", ms=3, lw=1.1, alpha=0.8,
                  label=label if place < MOST else None) if drawn else None
    for label, points in comparison.published.items():
        drawn = [(x, y) for x, y, _ in points if math.isfinite(x) and math.isfinite(y)]
        if drawn:
            x, y = zip(*drawn)
            spread = [comparison.uncertainty * (abs(v) if comparison.is_relative else 1.0) for v in y]
            axes.errorbar(x, y, spread, fmt="ks", ms=2.5, lw=0.7, elinewidth=0.6, label=label)
    if comparison.line:
        x, y = zip(*comparison.line)
        axes.plot(x, y, "k-", lw=1.4, label="reference")
        spread = [comparison.uncertainty * (abs(v) if comparison.is_relative else 1.0) for v in y]
        axes.fill_between(x, [v - s for v, s in zip(y, spread)], [v + s for v, s in zip(y, spread)], color=GREY,
                          alpha=0.25, lw=0)
    if comparison.is_logarithmic:
        axes.set(xscale="log", yscale="log")
    axes.set(xlabel=comparison.x, ylabel=comparison.y)
    axes.set_title(comparison.title, fontsize=8)
    axes.legend(loc="best")


def draw_errors(axes: Axes, name: str, records: list[Record]) -> None:
    """Size of the main error against seconds of one core, a line for runs that differ in resolution alone."""
    case = find(name)
    for place, (label, members) in enumerate(group_series(name, records).items()):
        points = [(r.seconds, max(abs(value_of(r, case.main_error)), 1e-17)) for r in members]
        axes.plot(*zip(*points), "o-", ms=3, lw=1, alpha=0.8, label=label if 0 < len(label) < 45 and place < MOST
                  else None)
    unit = case.units.get(case.main_error, "")
    axes.set(xlabel="seconds on one core", ylabel=f"error ({case.main_error}{f' [{unit}]' if unit else ''})",
             xscale="log", yscale="log")
    axes.set_title("error against run time", fontsize=8)
    for axis in (axes.xaxis, axes.yaxis):
        label_sparsely(axis)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best")


def label_sparsely(axis: Axis) -> None:
    """Label 1, 2 and 5 of every decade of a logarithmic axis that has less than two; else the decades."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def value_of(record: Record, name: str) -> float:
    """An error of a stored run; not a number where it was not finite."""
    value: Any = record.errors.get(name)
    return math.nan if value is None else float(value)

"""Charts of curves over time, and the file in which a run keeps those of its page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mpm.errors import InvalidValue
from mpm.files import quote
from robosim.base.input_files import check_form, read_json

FILE = "curves.json"
COLOURS = ("#1f6fd6", "#d9661f", "#2e8b57", "#8a3ab9", "#c0392b", "#7f6a3f", "#c2489b", "#5b6770", "#8f9a1f", "#1c9fb0")
"""Of the curves of a chart, and of the series of a plot."""
MOST_POINTS = 1500
"""Points of a curve; of a longer one the least and the largest of each of half as many equal parts are drawn."""
FORM = [{"title": str, "most": (float, None), "least": (float, None), "is_logarithmic": bool,
         "curves": [{"name": str, "times": [float], "values": [(float, None)], "dashed": bool}]}]


class Curve(NamedTuple):
    """A curve of a chart."""

    name: str
    times: np.ndarray
    """(n,) [s]"""
    values: np.ndarray
    """(n,) in the chart's unit; NaN leaves a gap."""
    dashed: bool = False


class Chart(NamedTuple):
    """Curves of one unit."""

    title: str
    """With the unit."""
    curves: Sequence[Curve]
    most: float | None = None
    """Upper end of what is accepted, drawn as a line; `least` likewise."""
    least: float | None = None
    is_logarithmic: bool = False


def pack_charts(charts: Sequence[Chart]) -> list[dict[str, Any]]:
    """Return charts as values of JSON, with six digits, thinned out; a gap is null."""
    packed = []
    for chart in charts:
        drawn = [(curve, *thin_out(curve.times, curve.values)) for curve in chart.curves]
        packed.append(chart._asdict() | {"is_logarithmic": bool(chart.is_logarithmic), "curves": [
            {"name": curve.name, "dashed": curve.dashed, "times": [float(f"{t:.6g}") for t in times],
             "values": [float(f"{v:.6g}") if np.isfinite(v) else None for v in values]}
            for curve, times, values in drawn]})
    return packed


def read_charts(path: Path) -> list[Chart]:
    """Read what `pack_charts` returned; raises OSError, and ValueError for another form."""
    charts = read_json(path)
    check_form(charts, FORM, str(path))
    for chart in charts:
        for curve in chart["curves"]:
            if len(curve["times"]) != len(curve["values"]) or curve["times"] != sorted(curve["times"]):
                raise InvalidValue(f"{path}: {quote(chart['title'])}, {quote(curve['name'])}: times not in order, or "
                                   f"not as many as values")
    return [Chart(chart["title"], [
        Curve(curve["name"], np.array(curve["times"], float), np.array(curve["values"], float), curve["dashed"])
        for curve in chart["curves"]], chart["most"], chart["least"], chart["is_logarithmic"]) for chart in charts]


def thin_out(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return at most MOST_POINTS points of a curve, with the least and the largest value of each part of it."""
    if len(times) <= MOST_POINTS:
        return times, values
    kept: list[int] = []
    for part in np.array_split(np.arange(len(times)), MOST_POINTS // 2):
        finite = part[np.isfinite(values[part])]
        kept += sorted({int(finite[find(values[finite])]) for find in (np.argmin, np.argmax)} if len(finite) else
                       {int(part[0])})
    return times[kept], values[kept]

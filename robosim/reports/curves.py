"""Curves over time, one above the other on one axis of time, with marks and accepted ranges."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from plotly.graph_objects import Scatter
from plotly.subplots import make_subplots

from robosim.reports.plot import COLOURS, LAYOUT, mark_level, to_html

MOST_POINTS = 1500
"""Points of a curve; longer ones are means over equal parts, with the extremes of each part kept."""
ROW_HEIGHT, TOP, MARKED_TOP = 180, 40, 90
"""Height of a chart, and of what is above all charts, without and with names of marks [pixels]."""


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


def draw_charts(charts: Sequence[Chart], marks: dict[str, float], x: str = "time [s]") -> str:
    """Draw charts with marks on their common axis, named above the first one; return HTML. x: title of the axis."""
    figure = make_subplots(len(charts), 1, shared_xaxes=True, vertical_spacing=0.25 / max(len(charts), 2),
                           subplot_titles=[chart.title for chart in charts])
    for row, chart in enumerate(charts, 1):
        for k, curve in enumerate(chart.curves):
            times, values = thin_out(curve.times, curve.values)
            figure.add_trace(Scatter(x=times, y=values, name=curve.name, mode="lines", legend=legend_name(row),
                                     hovertemplate=f"{curve.name}: %{{y:.4g}}<extra></extra>",
                                     line={"width": 1.4, "color": COLOURS[k % len(COLOURS)],
                                           "dash": "dash" if curve.dashed else "solid"}), row=row, col=1)
        for value in (chart.most, chart.least):
            if value is not None:
                mark_level(figure, value, f"accepted: {value:g}", is_log=chart.is_logarithmic, xref="x domain", row=row,
                           col=1)
        if chart.is_logarithmic:
            figure.update_yaxes(type="log", exponentformat="power", row=row, col=1)
    layout: Any = figure.layout
    lines = [{"type": "line", "x0": time, "x1": time, "xref": f"x{row}", "y0": 0, "y1": 1, "yref": f"y{row} domain",
              "line": {"color": "rgba(0,0,0,0.18)", "width": 1}}
             for time in marks.values() for row in ["", *range(2, len(charts) + 1)]]
    names = [{"x": time, "y": 1.0, "xref": "x", "yref": "paper", "text": name, "textangle": -60, "showarrow": False,
              "xanchor": "left", "yanchor": "bottom", "yshift": 18, "font": {"size": 10, "color": "#555"}}
             for name, time in marks.items()]
    # all at once: for each one that is added plotly makes all others anew
    figure.update_layout(shapes=[*layout.shapes, *lines], annotations=[*layout.annotations, *names])
    figure.update_xaxes(title_text=x, row=len(charts), col=1)
    top, bottom = (MARKED_TOP if marks else TOP), 40
    figure.update_layout({**LAYOUT, "height": top + bottom + ROW_HEIGHT * len(charts), "hovermode": "x unified",
                          "margin": {"l": 60, "r": 20, "t": top, "b": bottom}, "showlegend": True})
    for row in range(1, len(charts) + 1):  # beside its chart
        end = layout[f"yaxis{row}"].domain[1]
        figure.update_layout({legend_name(row): {"x": 1.01, "xanchor": "left", "y": end, "yanchor": "top",
                                                 "font": {"size": 11}, "tracegroupgap": 2}})
    return to_html(figure)


def legend_name(row: int) -> str:
    """Return the name of the legend of a chart, as plotly counts them."""
    return "legend" if row == 1 else f"legend{row}"


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

"""Plots of points with tooltips, such as errors against run time; and curves over time, one above the other on one axis
of time, with marks and accepted ranges."""

import math
from collections.abc import Sequence
from typing import Any

from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from robosim.reports.curves import COLOURS, Chart, thin_out

MARKERS = ("circle", "square", "diamond", "triangle-down", "triangle-up", "star", "pentagon", "x", "triangle-right",
           "triangle-left")
LAYOUT = {"template": "plotly_white", "font": {"family": "system-ui, sans-serif", "size": 12},
          "margin": {"l": 70, "r": 20, "t": 46, "b": 50}}
"""Of all figures."""
CONFIG = {"displaylogo": False, "responsive": True, "modeBarButtonsToRemove": ["select2d", "lasso2d"]}
ROW_HEIGHT, TOP, MARKED_TOP = 180, 40, 90
"""Height of a chart, and of what is above all charts, without and with names of marks [pixels]."""


class Plot:
    """A plot of series of points, logarithmic by default."""

    def __init__(self, title: str, x: str, y: str, *, logarithmic: bool = True, height: int = 440) -> None:
        scale = "log" if logarithmic else "linear"
        self.figure = Figure(layout={**LAYOUT, "title": {"text": title}, "height": height,
                                     "xaxis": {"title": {"text": x}, "type": scale, "exponentformat": "power"},
                                     "yaxis": {"title": {"text": y}, "type": scale, "exponentformat": "power"}})
        self._series = 0

    def add_series(self, points: Sequence[tuple[float, float]], tooltips: Sequence[str], label: str, *,
                   joined: bool = True) -> None:
        """Add a series of points (x, y) with a tooltip each; joined: by a line, otherwise larger open marks."""
        marker, colour = (choices[self._series % len(choices)] for choices in (MARKERS, COLOURS))
        x, y = zip(*points)
        self.figure.add_trace(Scatter(
            x=x, y=y, name=label, mode="lines+markers" if joined else "markers", line={"width": 1, "color": colour},
            marker={"symbol": marker if joined else f"{marker}-open", "size": 8 if joined else 10, "color": colour},
            hovertext=[tooltip.replace("\n", "<br>") for tooltip in tooltips], hoverinfo="text"))
        self._series += 1

    def add_front(self, points: Sequence[tuple[float, float]]) -> None:
        """Add the Pareto front as a dotted line."""
        if len(points) > 1:
            x, y = zip(*points)
            self.figure.add_trace(Scatter(x=x, y=y, name="Pareto front", mode="lines", hoverinfo="skip",
                                          line={"width": 3, "dash": "dot", "color": "rgba(0,0,0,0.35)"}))

    def add_band(self, high: float, where: str = "") -> None:
        """Mark the values that are accepted, all up to an upper end; where: the runs that this holds for."""
        is_log = self.figure.layout.yaxis.type == "log"  # pyright: ignore[reportAttributeAccessIssue]
        mark_level(self.figure, high, f"accepted up to {high:g}{where}", is_log=is_log, xref="paper")

    def add_line(self, corners: Sequence[tuple[float, float]], uncertainty: float, *, is_relative: bool) -> None:
        """Add a reference's line through corners (x, y), and dashed ones at either end of its uncertainty in y."""
        for side, dash in ((0.0, "solid"), (-1.0, "dash"), (1.0, "dash")):
            y = [v * (1 + side * uncertainty) if is_relative else v + side * uncertainty for _, v in corners]
            self.figure.add_trace(Scatter(
                x=[x for x, _ in corners], y=y, name="reference" if side == 0.0 else "its uncertainty", mode="lines",
                showlegend=side <= 0.0 and (side == 0.0 or uncertainty > 0.0), hoverinfo="skip",
                line={"width": 1.5, "color": "rgba(0,0,0,0.55)", "dash": dash}))

    def add_reference(self, x: float, label: str) -> None:
        """Mark what the others are compared with, by its place on the horizontal axis alone."""
        self.figure.add_vline(x, line={"color": "#555", "width": 1, "dash": "dash"})
        place = math.log10(x) if self.figure.layout.xaxis.type == "log" else x  # pyright: ignore[reportAttributeAccessIssue]
        self.figure.add_annotation(x=place, y=1.0, yref="paper", text=label, textangle=-90, xanchor="right",
                                   yanchor="top", showarrow=False, font={"size": 10, "color": "#555"})

    def html(self) -> str:
        """Return the plot as HTML, for a page that has the script."""
        return to_html(self.figure)


def mark_level(figure: Figure, value: float, text: str, *, is_log: bool, xref: str, **chart: int) -> None:
    """Draw a horizontal line with a text at its end; xref: axis of its end. chart: row and column of one of several."""
    figure.add_hline(value, line={"color": "#2a2", "width": 1, "dash": "dash"}, **chart)  # pyright: ignore[reportArgumentType]
    # plotly takes the logarithm of a line's place itself, but not of a text's
    figure.add_annotation(x=1.0, xref=xref, xanchor="right", yanchor="bottom", text=text, showarrow=False,
                          y=math.log10(value) if is_log else value, font={"color": "#282", "size": 11}, **chart)


def to_html(figure: Figure) -> str:
    """Return a figure as HTML, for a page that has the script."""
    return figure.to_html(full_html=False, include_plotlyjs=False, config=CONFIG)


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

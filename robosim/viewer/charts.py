"""The curves of a recording over time, with a cursor in step with its scene."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser
from viser import uplot

from robosim.recordings.header import CurveEntry
from robosim.recordings.reader import Recording
from robosim.reports.curves import COLOURS, Chart, Curve

WIDTH, HEIGHT = 380, 130
"""Of the panel beside the scene, and of a chart in it [pixels]."""
FAR, MARGIN = 100.0, 0.05
"""Heights of a chart by which a curve without a value lies below it; margin above and below, as a share of the range.
"""
BEYOND = 0.05
"""Time [s] of a frame before or after a curve at which that still has its first or last value."""
LEAST = 1e-16
"""Below it a logarithmic chart shows no difference: rounding."""
ACCEPTED, LEVEL, DASH = "accepted", "#22aa22", (6.0, 4.0)
"""Name and colour of the ends of what is accepted; dashes and gaps [pixels]."""


class History:
    """Times, curves, positions of the tool and forces on it, of all frames that were read."""

    def __init__(self, recording: Recording) -> None:
        self._recording, header = recording, recording.header
        self._tool = next((k for k, body in enumerate(header.moving) if body.name == header.tool), None)
        self.times = np.zeros(0)
        """(frames,) [s]"""
        self.values = np.zeros((0, len(header.curves)))
        """(frames, curves)"""
        self.tool_positions = np.zeros((0, 3))
        """(frames, 3) [m]; zero without a tool."""
        self.forces = np.zeros((0, 3))
        """(frames, 3) [N] of the grains on the tool."""

    @property
    def largest_force(self) -> float:
        """[N]"""
        return float(np.linalg.norm(self.forces, axis=1).max()) if len(self.forces) else 0.0

    def refresh(self) -> bool:
        """Read the frames that were added; return whether there were any."""
        new = [self._recording.scene(k) for k in range(len(self.times), len(self._recording))]
        if not new:
            return False
        places = [np.zeros(3) if self._tool is None else r.poses[self._tool, :3] for r in new]
        self.times = np.append(self.times, [r.time for r in new])
        self.values = np.concatenate([self.values, [r.values for r in new]])
        self.tool_positions = np.concatenate([self.tool_positions, places])
        self.forces = np.concatenate([self.forces, [r.wrench[:3] for r in new]])
        return True

    def nearest(self, time: float) -> int:
        """Return the frame whose time [s] is nearest."""
        k = int(np.clip(np.searchsorted(self.times, time), 1, max(len(self.times) - 1, 1)))
        return k if k < len(self.times) and abs(self.times[k] - time) < abs(self.times[k - 1] - time) else k - 1


class Charts:
    """Charts in a panel of their own: those of the page of a run that has ended, or one for each name that the curves
    of its recording give."""

    def __init__(self, server: viser.ViserServer, curves: list[CurveEntry], history: History,
                 charts: Sequence[Chart] = ()) -> None:
        self._history, self._curves, self._charts = history, curves, charts
        self._handles: list[Any] = []
        self._rows: list[np.ndarray] = []
        self._ranges: list[tuple[float, float]] = []
        drawn = self._charts or charts_of_frames(curves, history)
        if not drawn:
            return
        panel = server.gui.add_panel()
        with panel.add_tab("curves"):
            for chart in drawn:
                lines = [uplot.Series(label=curve.name, width=1.5, dash=DASH if curve.dashed else (),
                                      stroke=LEVEL if curve.name == ACCEPTED else COLOURS[k % len(COLOURS)])
                         for k, curve in enumerate(with_levels(chart))]
                now = uplot.Series(label="now", stroke="#222222", width=1.0)
                self._handles.append(server.gui.add_uplot(
                    data=tuple(np.zeros(2) for _ in range(len(lines) + 2)),
                    series=(uplot.Series(label="t [s]"), *lines, now),
                    title=f"logarithm of the {chart.title}" if chart.is_logarithmic else chart.title, height=HEIGHT,
                    scales=make_scales(0.0, 1.0), legend=uplot.Legend(show=True)))
        panel.dock_left()
        panel.set_width(WIDTH)

    def refresh(self) -> None:
        """Follow the history, which has grown."""
        drawn = self._charts or charts_of_frames(self._curves, self._history)
        self._rows = [sample(chart, self._history.times) for chart in drawn]
        self._ranges = [value_range(rows) for rows in self._rows]
        for handle, one in zip(self._handles, self._ranges):
            handle.scales = make_scales(*one)

    def show(self, time: float) -> None:
        """Move the cursor to a time [s]."""
        times = self._history.times
        if len(times) < 2:
            return
        for handle, rows, (low, high) in zip(self._handles, self._rows, self._ranges):
            handle.data = add_cursor(times, rows, self._history.nearest(time), low, high)


def charts_of_frames(curves: list[CurveEntry], history: History) -> list[Chart]:
    """Return the charts of what every frame has."""
    groups: dict[str, list[int]] = {}
    for k, curve in enumerate(curves):
        groups.setdefault(curve.chart, []).append(k)
    units = {name: curves[columns[0]].unit for name, columns in groups.items()}
    return [Chart(f"{name} [{units[name]}]" if units[name] else name,
                  [Curve(curves[k].name, history.times, history.values[:, k]) for k in columns])
            for name, columns in groups.items()]


def with_levels(chart: Chart) -> list[Curve]:
    """Return the curves of a chart, and level ones at the ends of what is accepted."""
    ends = np.array([curve.times[[0, -1]] for curve in chart.curves if len(curve.times)])
    span = np.array([ends.min(), ends.max()]) if len(ends) else np.zeros(0)
    return [*chart.curves, *(Curve(ACCEPTED, span, np.full(len(span), level), dashed=True)
                             for level in (chart.least, chart.most) if level is not None)]


def sample(chart: Chart, times: np.ndarray) -> np.ndarray:
    """Return the curves of a chart as rows (k, n) at times (n,) [s]; of a logarithmic one their logarithms."""
    curves = with_levels(chart)
    rows = np.full((len(curves), len(times)), np.nan)
    for row, curve in zip(rows, curves):
        if len(curve.times):
            inside = (times > curve.times[0] - BEYOND) & (times < curve.times[-1] + BEYOND)
            row[inside] = np.interp(times[inside], curve.times, curve.values)
    return np.log10(np.maximum(rows, LEAST)) if chart.is_logarithmic else rows


def make_scales(low: float, high: float) -> dict[str, uplot.Scale]:
    """Return the axes of a chart; the browser's own range of values fails where some are missing."""
    return {"x": uplot.Scale(time=False), "y": uplot.Scale(range=(low, high))}


def value_range(values: np.ndarray) -> tuple[float, float]:
    """Return a range that holds the finite values with a margin; (0, 1) without any."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    margin = MARGIN * max(high - low, 1e-6 * max(abs(low), abs(high)), 1e-9)
    return low - margin, high + margin


def add_cursor(times: np.ndarray, rows: np.ndarray, near: int, low: float, high: float) -> tuple[np.ndarray, ...]:
    """Return times, curves (k, n) and a vertical line at a frame, as rows of one length for a chart.
    Where a curve has no value it leaves the picture: the browser would join what is on both sides."""
    rows = np.where(np.isfinite(rows), rows, low - FAR * (high - low))
    x = np.insert(times, near, times[near])
    cursor = np.full(len(x), np.nan)
    cursor[near], cursor[near + 1] = low, high
    return (x, *(np.insert(row, near, row[near]) for row in rows), cursor)

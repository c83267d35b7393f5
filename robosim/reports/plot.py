"""Plots as SVG text, with a tooltip on every point."""

import io
import re
from collections.abc import Sequence
from xml.etree import ElementTree

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
from matplotlib.figure import Figure  # noqa: E402

SVG = "http://www.w3.org/2000/svg"
MARKERS = "osD^vP*X<>"


class Plot:
    """A plot of series of points, logarithmic by default."""

    def __init__(self, title: str, x: str, y: str, *, logarithmic: bool = True,
                 size: tuple[float, float] = (10.0, 4.6)) -> None:
        self.figure, self.axes = plt.subplots(figsize=size, layout="constrained")
        self.axes.set(title=title, xlabel=x, ylabel=y)
        if logarithmic:
            self.axes.set(xscale="log", yscale="log")
        self.axes.grid(True, which="major", alpha=0.3)
        self._tooltips: dict[str, str] = {}
        self._series = 0

    def add_series(self, points: Sequence[tuple[float, float]], tooltips: Sequence[str], label: str, *,
                   joined: bool = True) -> None:
        """Add a series of points (x, y) with a tooltip each; joined: by a line, otherwise larger open marks."""
        marker = MARKERS[self._series % len(MARKERS)]
        line, = self.axes.plot(*zip(*points), "-" if joined else "", lw=1, alpha=0.7, label="_")
        for k, (point, tooltip) in enumerate(zip(points, tooltips)):
            mark, = self.axes.plot(*point, marker, ms=7 if joined else 9, color=line.get_color(),
                                   mfc=None if joined else "none", label=label if k == 0 else "_")
            mark.set_gid(f"point-{len(self._tooltips)}")
            self._tooltips[mark.get_gid() or ""] = tooltip
        self._series += 1

    def add_front(self, points: Sequence[tuple[float, float]]) -> None:
        """Add the Pareto front as a dotted line."""
        if len(points) > 1:
            self.axes.plot(*zip(*points), "k:", lw=2.5, alpha=0.35, label="Pareto front", zorder=0)

    def add_band(self, high: float) -> None:
        """Mark the values that are accepted: all up to an upper end."""
        self.axes.axhspan(self.axes.get_ylim()[0], high, color="#2a2", alpha=0.08, lw=0, zorder=-1)
        self.axes.axhline(high, color="#2a2", lw=1, ls="--", label=f"accepted up to {high:g}")

    def svg(self) -> str:
        """Return the plot as an <svg> element and free the figure."""
        if self._series:
            self.figure.legend(fontsize=7, loc="outside right upper")
        text = to_svg(self.figure, self._tooltips)
        plt.close(self.figure)
        return text


def to_svg(figure: Figure, tooltips: dict[str, str]) -> str:
    """Convert a figure to an <svg> element, with tooltips for the parts of these ids."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    root = ElementTree.fromstring(re.sub(r"<!DOCTYPE[^>]*>", "", buffer.getvalue()))
    for element in root.iter(f"{{{SVG}}}g"):
        tooltip = tooltips.get(element.get("id", ""))
        if tooltip is not None:
            title = ElementTree.Element(f"{{{SVG}}}title")
            title.text = tooltip
            element.insert(0, title)
    return ElementTree.tostring(root, encoding="unicode")

"""Plots as SVG text whose points tell their values when the pointer rests on them."""

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
    """Axes of error against seconds, or of anything else; every point that is added may have words."""

    def __init__(self, title: str, x: str, y: str, *, logarithmic: bool = True,
                 size: tuple[float, float] = (10.0, 4.6)) -> None:
        self.figure, self.axes = plt.subplots(figsize=size, layout="constrained")
        self.axes.set(title=title, xlabel=x, ylabel=y)
        if logarithmic:
            self.axes.set(xscale="log", yscale="log")
        self.axes.grid(True, which="major", alpha=0.3)
        self._words: dict[str, str] = {}
        self._series = 0

    def line(self, points: Sequence[tuple[float, float]], words: Sequence[str], label: str, *,
             own: bool = True) -> None:
        """A series (x, y); own: joined by a line, otherwise bare marks."""
        marker = MARKERS[self._series % len(MARKERS)]
        drawn, = self.axes.plot(*zip(*points), "-" if own else "", lw=1, alpha=0.7, label="_")
        for k, (point, word) in enumerate(zip(points, words)):
            mark, = self.axes.plot(*point, marker, ms=7 if own else 9, color=drawn.get_color(),
                                   mfc=None if own else "none", label=label if k == 0 else "_")
            mark.set_gid(f"point-{len(self._words)}")
            self._words[mark.get_gid() or ""] = word
        self._series += 1

    def front(self, points: Sequence[tuple[float, float]]) -> None:
        """The points that nothing beats, joined."""
        if len(points) > 1:
            self.axes.plot(*zip(*points), "k:", lw=2.5, alpha=0.35, label="Pareto front", zorder=0)

    def band(self, high: float) -> None:
        """What is accepted: everything below."""
        self.axes.axhspan(self.axes.get_ylim()[0], high, color="#2a2", alpha=0.08, lw=0, zorder=-1)
        self.axes.axhline(high, color="#2a2", lw=1, ls="--", label=f"accepted up to {high:g}")

    def svg(self) -> str:
        """The picture, without what stands before its <svg>."""
        if self._series:
            self.figure.legend(fontsize=7, loc="outside right upper")
        text = as_svg(self.figure, self._words)
        plt.close(self.figure)
        return text


def as_svg(figure: Figure, words: dict[str, str]) -> str:
    """A figure as SVG, with words for the parts of these names."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    root = ElementTree.fromstring(re.sub(r"<!DOCTYPE[^>]*>", "", buffer.getvalue()))
    for element in root.iter(f"{{{SVG}}}g"):
        word = words.get(element.get("id", ""))
        if word is not None:
            title = ElementTree.Element(f"{{{SVG}}}title")
            title.text = word
            element.insert(0, title)
    return ElementTree.tostring(root, encoding="unicode")

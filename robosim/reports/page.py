"""Self-contained HTML pages: opened from disk, they need no network."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from robosim.base.provenance import provenance
from robosim.reports.curves import Chart, Curve
from robosim.reports.plot import draw_charts

STATUSES = ("pass", "weak", "fail", "not run", "stable", "refused", "unstable", "held", "missed")
"""Words that a table shows in a colour of their own."""
HeatCell = tuple[str, str, str]
"""Text of a cell, its status, and its tooltip."""


class Cell(NamedTuple):
    """A cell of a table."""

    text: str
    number: str | None = None
    """By which the column is sorted."""
    status: str = ""
    """Class of its colour."""


class Page:
    """A page, built from top to bottom, with the command, commit and machine in its header.
    origin: replaces entries of `provenance`."""

    def __init__(self, title: str, origin: dict[str, str] | None = None) -> None:
        self.title, self._origin = title, provenance() | (origin or {})
        self._blocks: list[dict[str, Any]] = []
        self._verdict: dict[str, Any] | None = None

    def set_verdict(self, text: str, *, holds: bool) -> None:
        """Say at the top whether what was asked for holds."""
        self._verdict = {"text": text, "holds": holds}

    def add_heading(self, text: str) -> None:
        """Add a heading."""
        self._add("heading", text=text)

    def add_text(self, text: str) -> None:
        """Add a paragraph."""
        self._add("text", text=text)

    def add_plot(self, html: str, caption: str = "") -> None:
        """Add a plot, as `robosim.reports.plot` makes it, with a caption."""
        self._add("plot", html=html, caption=caption)

    def add_curves(self, charts: Mapping[str, Mapping[str, tuple[Sequence[float], Sequence[float]]]], x: str,
                   caption: str = "", *, is_logarithmic: bool = False) -> None:
        """Add charts one above the other: title -> name -> (values of x, values); x: name of the common axis."""
        drawn = [Chart(title, [Curve(name, np.asarray(at, float), np.asarray(values, float))
                               for name, (at, values) in curves.items()], is_logarithmic=is_logarithmic)
                 for title, curves in charts.items()]
        self.add_plot(draw_charts(drawn, {}, x), caption)

    def add_film(self, content: bytes, caption: str = "", still: bytes = b"") -> None:
        """Add a film; content: of an .mp4 file; still: of a .jpg file, shown until it plays."""
        self._add("film", data=base64.b64encode(content).decode(), caption=caption,
                  still=base64.b64encode(still).decode())

    def add_picture(self, content: bytes, caption: str = "") -> None:
        """Add a picture; content: of a .png file."""
        self._add("picture", data=base64.b64encode(content).decode(), caption=caption)

    def add_scene(self, document: str, caption: str = "") -> None:
        """Add a document of its own in a frame, such as a recording in 3-D."""
        self._add("scene", document=document, caption=caption)

    def add_details(self, summary: str, text: str) -> None:
        """Add a text that is folded away."""
        self._add("details", summary=summary, text=text)

    def add_table(self, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Add a table, unless it has no rows; numbers have four digits and sort by value, statuses are coloured."""
        cells = [[make_cell(value) for value in row] for row in rows]
        if cells:
            self._add("table", head=list(head), rows=cells)

    def add_heat_map(self, rows: dict[str, list[HeatCell]]) -> None:
        """Add rows of cells, coloured by status, with tooltips."""
        self._add("heat", rows=list(rows.items()), width=max(map(len, rows.values()), default=0))

    def _add(self, kind: str, **values: Any) -> None:
        self._blocks.append({"kind": kind, **values})

    def html(self) -> str:
        """Return the page as HTML."""
        has_plots = any(block["kind"] == "plot" for block in self._blocks)
        return templates().get_template("page.html.j2").render(
            title=self.title, blocks=self._blocks, origin=dict(self._origin), verdict=self._verdict,
            style=read_part("style.css"), behaviour=read_part("page.js"),
            script=read_part("plotly.min.js", "plotly", "package_data") if has_plots else "")


@cache
def templates() -> Environment:
    """Return the templates of all pages; they escape what they are given."""
    return Environment(loader=PackageLoader("robosim.reports", "templates"), autoescape=True, undefined=StrictUndefined)


@cache
def read_part(name: str, package: str = "robosim.reports", folder: str = "templates") -> str:
    """Return a file of a package's folder."""
    return files(package).joinpath(folder).joinpath(name).read_text(encoding="utf-8")


def make_cell(value: object) -> Cell:
    """Return a value as a cell of a table."""
    if value is None:
        return Cell("")
    if isinstance(value, float | int) and not isinstance(value, bool):
        return Cell(f"{value:.4g}", repr(value))
    text = str(value)
    return Cell(text, status=text.replace(" ", "-") if text in STATUSES else "")

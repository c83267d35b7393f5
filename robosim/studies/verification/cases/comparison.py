"""Comparison of a case's runs with reference data, in a form that a report can draw."""

from collections.abc import Sequence
from dataclasses import dataclass, field

Point = tuple[float, float, str]
"""x, y and tooltip."""


@dataclass(frozen=True)
class Comparison:
    """A plot of measured points beside those, or the line, of a reference.

    A case with `compare(records) -> list[Comparison]` has them drawn on the page of `robosim report`.
    """

    title: str
    x: str
    """Title of the axis, with the unit."""
    y: str
    """Title of the axis, with the unit."""
    measured: dict[str, list[Point]]
    """Label of a series -> its points."""
    source: str
    """Source of the reference."""
    uncertainty: float
    """Of the reference: absolute in y, or a share of it where `is_relative`."""
    published: dict[str, list[Point]] = field(default_factory=dict)
    """Label of a series of reference data -> its points."""
    line: Sequence[tuple[float, float]] = ()
    """Corners (x, y) of the reference's line."""
    is_relative: bool = False
    is_logarithmic: bool = False
    is_joined: bool = False
    """Whether lines join the measured points, too."""

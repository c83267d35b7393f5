"""The result of one cell of the stability report."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class CellResult:
    """Verdict and readings at one value of an axis."""

    axis: str
    """Name of the axis."""
    value: float | str
    """Value along the axis."""
    verdict: str
    """"stable", "refused" or "unstable"."""
    reason: str = ""
    """What failed first, or why the value is refused."""
    readings: dict[str, float] = field(default_factory=dict)
    """Largest or smallest values over the run."""


def cell_result(axis: str, value: float | str, failure: str, readings: dict[str, float]) -> CellResult:
    """Return the result of a run: unstable where something failed, otherwise stable."""
    return CellResult(axis, value, "unstable" if failure else "stable", failure, readings)

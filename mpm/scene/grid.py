"""The background grid's extent: a box of nodes whose faces are the walls."""

from dataclasses import dataclass

import numpy as np

from mpm.errors import InvalidValue

GHOST = 2
"""Nodes outside each wall: one is reached by the quadratic spline, one more keeps every stencil inside the array."""
BLOCK = 4
"""Nodes along the edge of a block of the active list."""
ROUNDING = 1e-3
"""Cells by which the position of a particle at a wall may be outside in single precision."""


@dataclass(frozen=True)
class Grid:
    """A box of nodes. Its six faces are walls; they lie on the first and last plane of nodes."""

    lower: tuple[float, float, float]
    """Lower corner [m]."""
    upper: tuple[float, float, float]
    """Upper corner [m]; rounded up to a whole number of cells."""
    cell: float
    """Edge of a cell [m]."""

    def __post_init__(self) -> None:
        if not 0 < self.cell < np.inf:
            raise InvalidValue(f"Grid: cell = {self.cell:g} m; accepted: a positive length")
        span = np.subtract(self.upper, self.lower)
        if span.shape != (3,) or not np.isfinite(span).all() or np.any(span < (1 - 1e-9) * self.cell):
            raise InvalidValue(f"Grid: {np.asarray(self.lower)} .. {np.asarray(self.upper)} m is no box of a cell of "
                               f"{self.cell:g} m or more")

    @property
    def cells(self) -> np.ndarray:
        """Cells along each axis (3,)."""
        return np.ceil(np.subtract(self.upper, self.lower) / self.cell - 1e-9).astype(int)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along each axis, with ghost nodes, rounded up to whole blocks."""
        nodes = self.cells + 1 + 2 * GHOST
        nx, ny, nz = (int(n) for n in -(-nodes // BLOCK) * BLOCK)
        return nx, ny, nz

    @property
    def origin(self) -> np.ndarray:
        """Position [m] (3,) of node (0, 0, 0)."""
        return np.asarray(self.lower, float) - GHOST * self.cell

    def check_inside(self, positions: np.ndarray, what: str = "", tolerance: float = 0.0) -> None:
        """Raise InvalidValue when a position [m] (n, 3) lies outside the walls, by more than `tolerance` cells.
        what: where the positions were given, for the message."""
        lower, slack = np.asarray(self.lower), tolerance * self.cell
        upper = lower + self.cells * self.cell
        outside = np.flatnonzero(np.any((positions < lower - slack) | (positions > upper + slack), axis=1))
        if len(outside):
            raise InvalidValue(f"{what}{len(outside)} particles lie outside the grid {lower} .. {upper} m, "
                               f"first: particle {outside[0]} at {positions[outside[0]]}")

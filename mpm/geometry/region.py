"""Regions of space in which particles are counted."""

from typing import NamedTuple

import numpy as np


class Region(NamedTuple):
    """A box along the axes of its frame; with `round`, an upright cylinder with an elliptic base.
    half: half sizes [m] (3,); infinite ones leave the axis out."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    round: bool = False

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Return whether points (n, 3) [m] in the region's frame lie in it (n,)."""
        columns = np.ascontiguousarray(np.asarray(points).T)  # a column at a time: a third of the time
        x, y, z = ((column - centre) / half for column, centre, half in zip(columns, self.centre, self.half))
        if self.round:
            return (np.abs(z) < 1.0) & (x**2 + y**2 < 1.0)
        return (np.abs(z) < 1.0) & (np.abs(x) < 1.0) & (np.abs(y) < 1.0)

    @property
    def row(self) -> list[float]:
        """Centre, reciprocal half sizes and whether it is round, as the kernels read it (7,)."""
        return [*self.centre, *(1.0 / h for h in self.half), float(self.round)]

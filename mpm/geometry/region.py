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
        offset = (np.asarray(points) - self.centre) / self.half
        upright = np.abs(offset[:, 2]) < 1.0
        if self.round:
            return upright & (offset[:, 0] ** 2 + offset[:, 1] ** 2 < 1.0)
        return upright & np.all(np.abs(offset[:, :2]) < 1.0, axis=1)

    @property
    def row(self) -> list[float]:
        """Centre, reciprocal half sizes and whether it is round, as the kernels read it (7,)."""
        return [*self.centre, *(1.0 / h for h in self.half), float(self.round)]

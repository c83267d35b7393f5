"""Progress of a solver: its time, and the sums of its last advance."""

from typing import NamedTuple

import numpy as np


class Momentum(NamedTuple):
    """Linear [N s] (3,) and angular [N m s] (3,) momentum, about the world's origin, with the affine part."""

    linear: np.ndarray
    angular: np.ndarray


class Progress:
    """Time [s], substeps since the start, and sums of the last advance.
    rows: of the ledger, see `LedgerRows`. dt: substep [s]."""

    def __init__(self, rows: int, dt: float) -> None:
        self.time, self.steps, self.substep = 0.0, 0, dt
        self.sums = np.zeros((rows, 6))
        """Sums of the last advance, see `LedgerRows`."""
        self.momentum: Momentum | None = None
        """Momentum after the last advance or load; None: not summed yet."""
        self.fastest: float | None = None
        """Largest speed [m/s] of a particle; None: not found yet."""

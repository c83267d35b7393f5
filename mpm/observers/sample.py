"""Positions and velocities of chosen particles in one array, filled by one launch."""

from typing import Any

import numpy as np

from mpm.backend import allocating, put, ti
from mpm.state.packs import LANES


@ti.data_oriented
class Sample:
    """Reads positions and velocities of chosen particles: on request, or after `Solver.attach` at the end of advances.

    chosen: indices (n,).
    """

    def __init__(self, solver: Any, chosen: np.ndarray) -> None:  # a Solver, which stands above
        self.particles, self.origin = solver.particles, tuple(float(c) for c in solver.grid.origin)
        with allocating():
            self.slots = ti.field(ti.i32, len(chosen))
            put(self.slots, self.particles.index[chosen].astype(np.int32))

        self.values = np.zeros((len(chosen), 6), np.float32)
        """Positions [m] and velocities [m/s] as last read, shape (n, 6)."""

    def read(self) -> np.ndarray:
        """Read the current state; return `values`."""
        self._copy(self.values)
        return self.values

    @ti.kernel
    def _copy(self, out: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.take(out, 0)

    @ti.func
    def take(self, out: ti.template(), first):
        """Store the present state in the rows of out from `first` on."""
        for i in range(self.slots.shape[0]):
            q, l = self.slots[i] // LANES, self.slots[i] % LANES
            for d in ti.static(range(3)):
                out[first + i, d] = ti.cast(self.particles.x[d][q][l] + self.origin[d], ti.f32)
                out[first + i, 3 + d] = ti.cast(self.particles.v[d][q][l], ti.f32)

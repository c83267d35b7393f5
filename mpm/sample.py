"""Positions and velocities of some grains in one array, filled by one launch."""

import numpy as np

from mpm.backend import allocating, put, ti
from mpm.particles import LANES


@ti.data_oriented
class Sample:
    """Reads chosen grains (indices) of a solver."""

    def __init__(self, solver, chosen: np.ndarray) -> None:  # noqa: ANN001  (a Solver; a cycle otherwise)
        self.particles, self.origin = solver.particles, tuple(float(c) for c in solver.grid.origin)
        with allocating():
            self.slots = ti.field(ti.i32, len(chosen))
            put(self.slots, self.particles.index[chosen].astype(np.int32))

    def read(self, out: np.ndarray) -> None:
        """Positions [m] and velocities [m/s] into out (n, 6), float32."""
        self._copy(out)

    @ti.kernel
    def _copy(self, out: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for i in range(self.slots.shape[0]):
            q, l = self.slots[i] // LANES, self.slots[i] % LANES
            for d in ti.static(range(3)):
                out[i, d] = ti.cast(self.particles.x[d][q][l] + self.origin[d], ti.f32)
                out[i, 3 + d] = ti.cast(self.particles.v[d][q][l], ti.f32)

"""Positions and velocities of chosen particles in one array, filled by one launch."""

import numpy as np

from mpm.backend import is_shared, put, ti
from mpm.observers.readings import Measured
from mpm.state.packs import LANES
from mpm.state.particles import ParticleFields


@ti.data_oriented
class SampleKernel:
    """What a `Sample` of so many particles compiles. origin: position [m] (3,) of the grid's node (0, 0, 0)."""

    def __init__(self, particles: ParticleFields, count: int, origin: tuple[float, float, float]) -> None:
        self.particles, self.origin, self.count, self.on_gpu = particles, origin, count, is_shared()
        self.slots = ti.field(ti.i32, count)

    @ti.kernel
    def copy(self, out: ti.types.ndarray()):
        """Store the present state in out (n, 6)."""
        ti.loop_config(serialize=not self.on_gpu)
        for i in range(self.slots.shape[0]):
            self.take_one(out, 0, i)

    @ti.func
    def take(self, out: ti.template(), first):
        """Store the present state in the rows of out from `first` on."""
        for i in range(self.slots.shape[0]):
            self.take_one(out, first, i)

    @ti.func
    def take_one(self, out: ti.template(), first, i):
        """Store particle i of those chosen in row first + i of out."""
        q, l = self.slots[i] // LANES, self.slots[i] % LANES
        for d in ti.static(range(3)):
            out[first + i, d] = ti.cast(self.particles.x[d][q][l] + self.origin[d], ti.f32)
            out[first + i, 3 + d] = ti.cast(self.particles.v[d][q][l], ti.f32)


class Sample:
    """Reads positions and velocities of chosen particles: on request, or after `Solver.attach` at the end of advances.

    chosen: indices (n,).
    """

    def __init__(self, solver: Measured, chosen: np.ndarray) -> None:
        readings = solver.readings
        self.tenure, particles, count = readings.tenure, readings.particles, len(chosen)
        origin = readings.fields.origin
        self.kernel: SampleKernel = self.tenure.assembly.take(("sample", count),
                                                              lambda: SampleKernel(particles, count, origin))
        put(self.kernel.slots, particles.index[chosen].astype(np.int32))
        self.values = np.zeros((count, 6), np.float32)
        """Positions [m] and velocities [m/s] as last read, shape (n, 6)."""

    def read(self) -> np.ndarray:
        """Read the present state; return `values`."""
        self.tenure.check_open()
        self.kernel.copy(self.values)
        return self.values

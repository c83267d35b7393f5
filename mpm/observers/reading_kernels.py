"""Kernels of readings: stress of all particles, distance of a collider from them, and samples of chosen particles."""

from typing import Any

import numpy as np

from mpm.backend import is_shared, once, put, ti
from mpm.geometry.rigid_motion import Pose
from mpm.materials.material import PARAMETERS
from mpm.materials.stress_update import current_stress
from mpm.materials.symmetric_tensor import FULL
from mpm.observers.counter_kernel import pose_of
from mpm.state.fields import Fields
from mpm.state.packs import LANES
from mpm.state.particles import ParticleFields


@ti.data_oriented
class StressReader:
    """What reading stresses compiles for a scene."""

    def __init__(self, fields: Fields) -> None:
        self.fields, self.on_gpu = fields, is_shared()

    def read(self) -> np.ndarray:
        """Return the Kirchhoff stress [Pa] of all particles, shape (n_particles, 3, 3)."""
        particles = self.fields.particles
        packed = np.zeros((6, particles.n_packs, LANES), self.fields.dtype)
        self._read(packed)
        return particles.unpack(packed)[:, list(FULL)].reshape(-1, 3, 3).astype(float)

    @ti.kernel
    def _read(self, out: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for q in range(self.fields.particles.pack_count[None]):
            for body in range(self.fields.parameters.densities.shape[0]):
                ends = self.fields.particles.range_table[body]
                if ends[0] <= q and q < ends[1]:
                    for index, law in ti.static(enumerate(self.fields.laws)):
                        if self.fields.parameters.law_index[body] == index:
                            p = [once(self.fields.parameters.law[body, i]) for i in range(PARAMETERS)]
                            tau = current_stress(self.fields, self.fields.particles, law, q, body, p)
                            for i in ti.static(range(6)):
                                for l in ti.static(range(LANES)):
                                    out[i, q, l] = tau[i][l]


@ti.data_oriented
class ClearanceKernel:
    """What reading the clearance of one collider compiles for a scene."""

    def __init__(self, fields: Fields, index: int) -> None:
        self.fields, self.index, self.on_gpu = fields, index, is_shared()
        self.nearest = ti.field(fields.real, ())

    def read(self, pose: Pose) -> float:
        """Return a lower bound [m] of the distance of the nearest particle from the collider at a pose."""
        origin = np.asarray(self.fields.origin)
        self._read(np.concatenate([pose.position - origin, pose.matrix.ravel()]).astype(self.fields.dtype))
        return float(self.nearest[None])

    @ti.kernel
    def _read(self, pose: ti.types.ndarray()):
        self.nearest[None] = 1e6
        ti.loop_config(serialize=not self.on_gpu)
        for q in range(self.fields.particles.pack_count[None]):
            self._look_at_pack(self.fields.particles, self.fields.colliders[self.index].sdf, pose, q)

    @ti.func
    def _look_at_pack(self, P: ti.template(), sdf: ti.template(), pose: ti.template(), q):
        c, R = pose_of(pose)
        for l in ti.static(range(LANES)):
            r = ti.Vector([P.x[d][q][l] for d in range(3)]) - c
            if P.volume[q][l] > 0.0 and r.norm() - sdf.radius < self.nearest[None]:
                ti.atomic_min(self.nearest[None], sdf.least_distance(R.transpose() @ r))


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
    chosen: indices (n,)."""

    def __init__(self, solver: Any, chosen: np.ndarray) -> None:
        self.tenure, particles, count, origin = solver.tenure, solver.particles, len(chosen), solver.fields.origin
        self.kernel: SampleKernel = self.tenure.assembly.take(("sample", count),
                                                              lambda: SampleKernel(particles, count, origin))
        put(self.kernel.slots, particles.index[chosen].astype(np.int32))
        self.values = np.zeros((count, 6), np.float32)  # positions [m] and velocities [m/s] as last read, shape (n, 6)

    def read(self) -> np.ndarray:
        """Read the present state; return `values`."""
        self.tenure.check_open()
        self.kernel.copy(self.values)
        return self.values

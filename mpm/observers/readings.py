"""Readings of a solver's particles and ledger in double precision; each call copies what it needs from the fields."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mpm.backend import default_precision
from mpm.backend.assembly import Tenure
from mpm.errors import InvalidValue, UnknownName
from mpm.geometry.rigid_motion import Pose, Wrench
from mpm.geometry.shell import SHELL_FACE
from mpm.materials.stress_update import LEAST_RATIO
from mpm.observers.reading_kernels import ClearanceKernel, StressReader
from mpm.scene.body import Body
from mpm.scene.scene import Scene
from mpm.state.fields import Fields
from mpm.state.particles import ParticleFields
from mpm.state.sleepers import AHEAD

STENCIL = 1.5 * 3**0.5  # cells from a particle to the farthest node that it gives mass to
SIDES = ("x-", "x+", "y-", "y+", "z-", "z+")  # names of the six walls, in the order of folding


class Momentum(NamedTuple):
    """Linear [N s] (3,) and angular [N m s] (3,) momentum, about the world's origin, with the affine part."""

    linear: np.ndarray
    angular: np.ndarray


class Progress:
    """Time [s], substeps since the start, and sums of the last advance.
    rows: of the ledger, see `LedgerRows`. dt: substep [s]."""

    def __init__(self, rows: int, dt: float) -> None:
        self.time, self.steps, self.substep = 0.0, 0, dt
        self.sums = np.zeros((rows, 6))  # sums of the last advance, see `LedgerRows`
        self.momentum: Momentum | None = None  # momentum after the last advance or load; None: not summed yet
        self.fastest: float | None = None  # largest speed [m/s] of a particle; None: not found yet

    def pass_time(self, duration: float, substeps: int) -> None:
        """Count the substeps of an advance [s] in which nothing moves."""
        self.time, self.steps, self.substep = self.time + duration, self.steps + substeps, duration / substeps
        self.sums[:] = 0.0


def received(row: np.ndarray, point: np.ndarray) -> Wrench:
    """Return the impulse that a collider or wall received, about a point [m] (3,), from its row of the ledger (6,)."""
    linear, angular = -row.reshape(2, 3)
    return Wrench(linear, angular - np.cross(np.asarray(point), linear))


class Readings:
    """Functions of a solver's fields that read them."""

    def __init__(self, tenure: Tenure, scene: Scene, progress: Progress) -> None:
        self.tenure, self.scene, self.progress = tenure, scene, progress

    @property
    def fields(self) -> Fields:
        """All run-time fields; raises InvalidValue once the solver is closed."""
        return self.tenure.assembly.shared["fields"]

    @property
    def particles(self) -> ParticleFields:
        """Fields of the particles; raises InvalidValue once the solver is closed."""
        return self.fields.particles

    def positions(self) -> np.ndarray:
        """Return positions [m], shape (n_particles, 3), float64, in the order of the bodies."""
        return self.particles.read(self.particles.x).astype(float) + self.scene.grid.origin

    def velocities(self) -> np.ndarray:
        """Return velocities [m/s], shape (n_particles, 3), float64."""
        return self.particles.read(self.particles.v).astype(float)

    @property
    def awake(self) -> np.ndarray:
        """Which particles are awake, (n_particles,); all without sleeping."""
        sleepers = self.fields.sleepers
        if sleepers is None:
            return np.ones(sum(self.particles.counts), bool)
        return self.particles.read([self.particles.rest])[:, 0] < sleepers.calm_time

    @property
    def sleepers_impulse(self) -> Wrench:
        """Impulse [N s], [N m s] on the particles awake that sleeping ones gave in the last advance, less their own.
        About the world's origin; it closes the ledger. Zero without sleeping."""
        return Wrench(*self.progress.sums[self.fields.rows.asleep].reshape(2, 3))

    @property
    def fastest(self) -> float:
        """Largest speed [m/s] of a particle."""
        if self.progress.fastest is None:
            self.progress.fastest = float(np.linalg.norm(self.velocities(), axis=1).max())
        return self.progress.fastest

    def masses(self) -> np.ndarray:
        """Return masses [kg], shape (n_particles,)."""
        volume = self.particles.read([self.particles.volume])[:, 0].astype(float)
        return volume * np.repeat([b.material.density for b in self.scene.bodies], self.particles.counts)

    def densities(self) -> np.ndarray:
        """Return the mass over the present volume [kg/m^3] of each particle, shape (n_particles,)."""
        initial = np.repeat([b.material.density for b in self.scene.bodies], self.particles.counts)
        return initial / self.volume_ratios()

    def stresses(self) -> np.ndarray:
        """Return Cauchy stresses [Pa], shape (n_particles, 3, 3), symmetric, tension positive.
        They are those that the laws give for the present strain; in a fluid, viscous stress included."""
        fields = self.fields
        reader = self.tenure.assembly.share("stresses", lambda: StressReader(fields))
        with default_precision(fields.features.precision):
            return reader.read() / self.volume_ratios(advanced=False)[:, None, None]

    def clearance(self, index: int, pose: Pose) -> float:
        """Return a lower bound [m] of the distance of the nearest particle from a collider at a pose.
        It is exact to a spacing of its lattice for a solid from a mesh, and exact for most other solids; a shell counts
        as the box that holds it. Negative where a particle is inside."""
        fields = self.fields
        kernel = self.tenure.assembly.share(("clearance", index), lambda: ClearanceKernel(fields, index))
        with default_precision(fields.features.precision):
            return kernel.read(pose)

    @property
    def contact_reach(self) -> float:
        """Clearance [m] beyond which a collider changes nothing that particles do within a substep.
        Contact acts at nodes up to `SHELL_FACE` cells from a surface; what sleeps wakes `AHEAD` of it."""
        return (STENCIL + SHELL_FACE + (AHEAD if self.fields.features.sleep else 0.0)) * self.fields.cell

    @property
    def ledger(self) -> np.ndarray:
        """Impulses on the particles in the last advance: gravity, walls, colliders; (linear, angular), (rows, 6).
        Angular ones are about the world's origin."""
        return self.progress.sums[: self.fields.rows.momentum]

    def passed_mass(self, index: int) -> np.ndarray:
        """Return the mass [kg] that each orifice of a collider has let through, (n_holes,), in their order.
        Counted from the start, or as a loaded state has it. Raises InvalidValue for a collider without orifices."""
        rows = {collider: (first, last) for _, collider, first, last in self.fields.features.orifice_rows}
        if index not in rows or self.fields.orifices is None:
            raise InvalidValue(f"passed_mass: collider {index} has no orifices; with some: {sorted(rows)}")
        first, last = rows[index]
        return self.fields.orifices.read()[first:last, 6]

    def wall_impulse(self, side: str, about: np.ndarray | None = None) -> Wrench:
        """Return the impulse [N s], [N m s] that a wall received in the last advance.
        side: "x-", "x+", "y-", "y+", "z-" or "z+". about: point [m] (3,), or None: the world's origin. Raises
        UnknownName for another side."""
        if side not in SIDES:
            raise UnknownName("side", side, SIDES)
        row = self.progress.sums[self.fields.rows.walls + SIDES.index(side)]
        return received(row, np.zeros(3) if about is None else about)

    def volume_ratios(self, advanced: bool = True) -> np.ndarray:
        """Return J (n,) of all particles. advanced: with the strain of the last velocities, see `_cauchy_green`."""
        particles = self.particles
        C = particles.read(particles.C).astype(float) * (1.0 if advanced else 0.0)
        ratios = np.sqrt(np.linalg.det(self._cauchy_green(C)))
        for body, chosen in self.ranges():
            if body.material.state == "volume":
                j = particles.read([particles.j])[chosen, 0].astype(float)
                # as `advance_volume`
                growth = np.exp(np.arcsinh(self.strain_lag * C[chosen][:, [0, 4, 8]].sum(1)))
                ratios[chosen] = np.maximum((1.0 + j) * growth, LEAST_RATIO)
        return ratios

    def ranges(self) -> Iterator[tuple[Body, slice]]:
        """Yield each body and the slice of its particles."""
        first = 0
        for body, count in zip(self.scene.bodies, self.particles.counts):
            yield body, slice(first, first + count)
            first += count

    @property
    def strain_lag(self) -> float:
        """Time [s] by which strains lag behind positions: a single substep begins by adding that of the last
        velocities, a stride ends with it."""
        return 0.0 if self.fields.features.strides else self.progress.substep

    def strains(self, C: np.ndarray) -> np.ndarray:
        """Return e = b - I of all particles, entries xx, yy, zz, xy, xz, yz (6, n), for C (n, 9).
        With the strain of the last velocities C, where it is not yet in e, the strain is that of the positions."""
        e = np.ascontiguousarray(self.particles.read(self.particles.e).T, float)
        a = np.ascontiguousarray((self.strain_lag * C).T)
        rows = [(e[0], e[3], e[4]), (e[3], e[1], e[5]), (e[4], e[5], e[2])]
        # (I + a) e + a, and that times (I + a)^T, and a^T
        p = [[rows[i][k] + a[3 * i] * rows[0][k] + a[3 * i + 1] * rows[1][k] + a[3 * i + 2] * rows[2][k] + a[3 * i + k]
              for k in range(3)] for i in range(3)]
        return np.stack([p[i][k] + p[i][0] * a[3 * k] + p[i][1] * a[3 * k + 1] + p[i][2] * a[3 * k + 2] + a[3 * k + i]
                         for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])

    def _cauchy_green(self, C: np.ndarray) -> np.ndarray:
        """Return b (n, 3, 3) of all particles, the identity for fluids; see `strains`."""
        if not self.particles.e:
            return np.tile(np.eye(3), (len(C), 1, 1))
        return np.eye(3) + self.strains(C).T[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]

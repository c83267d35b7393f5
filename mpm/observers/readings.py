"""What a solver can be asked for: its particles in double precision, their momentum and energy."""

from typing import Any

import numpy as np

from mpm.backend import default_precision
from mpm.backend.assembly import AssemblyOwner
from mpm.errors import InvalidValue, UnknownName
from mpm.geometry.rigid_motion import Pose, Wrench, check_pose
from mpm.observers import diagnostics
from mpm.observers.clearance import ClearanceKernel, reach_of
from mpm.observers.diagnostics import Diagnostics, Energy, Momentum
from mpm.observers.stress_reader import StressReader
from mpm.scene.body import Body
from mpm.scene.features import Features
from mpm.scene.grid import Grid
from mpm.state.fields import Fields
from mpm.state.particles import ParticleFields

SIDES = ("x-", "x+", "y-", "y+", "z-", "z+")
"""Names of the six walls, in the order of folding."""


def received(row: np.ndarray, point: np.ndarray) -> Wrench:
    """Return what something received, about a point [m] (3,), where a row of the ledger (6,) has what particles did."""
    linear, angular = -row.reshape(2, 3)
    return Wrench(linear, angular - np.cross(np.asarray(point), linear))


class Readings(AssemblyOwner):
    """The part of a `Solver` that reads; each call copies what it needs from the fields."""

    bodies: list[Body]
    grid: Grid
    features: Features
    paths: Any
    mobility: Any
    sums: np.ndarray
    _momentum: Momentum | None
    """After the last advance or load; None: not summed yet."""
    _fastest: float | None

    @property
    def fields(self) -> Fields:
        """All run-time fields; raises InvalidValue once the solver is closed."""
        return self.assembly.shared["fields"]

    @property
    def particles(self) -> ParticleFields:
        """Fields of the particles; raises InvalidValue once the solver is closed."""
        return self.fields.particles

    def positions(self) -> np.ndarray:
        """Return positions [m], shape (n_particles, 3), float64, in the order of the bodies."""
        return self.particles.read(self.particles.x).astype(float) + self.grid.origin

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

        About the world's origin; it closes the ledger. Zero without sleeping.
        """
        return Wrench(*self.sums[self.fields.rows.asleep].reshape(2, 3))

    @property
    def fastest(self) -> float:
        """Largest speed [m/s] of a particle."""
        if self._fastest is None:
            self._fastest = float(np.linalg.norm(self.velocities(), axis=1).max())
        return self._fastest

    def masses(self) -> np.ndarray:
        """Return masses [kg], shape (n_particles,)."""
        volume = self.particles.read([self.particles.volume])[:, 0].astype(float)
        return volume * np.repeat([b.material.density for b in self.bodies], self.particles.counts)

    def densities(self) -> np.ndarray:
        """Return the mass over the present volume [kg/m^3] of each particle, shape (n_particles,)."""
        initial = np.repeat([b.material.density for b in self.bodies], self.particles.counts)
        return initial / diagnostics.volume_ratios(self)

    def stresses(self) -> np.ndarray:
        """Return Cauchy stresses [Pa], shape (n_particles, 3, 3), symmetric, tension positive.

        They are those that the laws give for the present strain; in a fluid, viscous stress included.
        """
        fields = self.fields
        reader = self.assembly.share("stresses", lambda: StressReader(fields))
        with default_precision(fields.features.precision):
            return reader.read() / diagnostics.volume_ratios(self, advanced=False)[:, None, None]

    def clearance(self, index: int, pose: Pose | None = None) -> float:
        """Return a lower bound [m] of the distance of the nearest particle from a collider, at a pose or where it is.

        It is exact to a spacing of its lattice for a solid from a mesh, and exact for most other solids; a shell counts
        as the box that holds it. Negative where a particle is inside.
        """
        fields, here = self.fields, self.paths.pose(index) if pose is None else check_pose("clearance", pose)
        kernel = self.assembly.share(("clearance", index), lambda: ClearanceKernel(fields, index))
        with default_precision(fields.features.precision):
            return kernel.read(here)

    @property
    def contact_reach(self) -> float:
        """Clearance [m] beyond which a collider changes nothing that particles do within a substep."""
        return reach_of(self.fields)

    @property
    def ledger(self) -> np.ndarray:
        """Impulses on the particles in the last advance: gravity, walls, colliders; (linear, angular), (rows, 6).

        Angular ones are about the world's origin.
        """
        return self.sums[: self.fields.rows.momentum]

    def collider_impulse(self, index: int, about: np.ndarray | None = None) -> Wrench:
        """Return the impulse [N s], [N m s] that a collider received in the last advance.

        about: point [m] (3,), or None: the centre of a mobile collider as it moved, the origin of another at the end of
        the advance.
        """
        here = self.paths.pose(index).position
        if about is None and index in self.features.mobile:
            return self.mobility.impulse(index)
        return received(self.ledger[self.fields.rows.first_collider + index], here if about is None else about)

    def passed_mass(self, index: int) -> np.ndarray:
        """Return the mass [kg] that each orifice of a collider has let through, (n_holes,), in their order.

        Counted from the start, or as a loaded state has it. Raises InvalidValue for a collider without orifices.
        """
        rows = {collider: (first, last) for _, collider, first, last in self.features.orifice_rows}
        if index not in rows or self.fields.orifices is None:
            raise InvalidValue(f"passed_mass: collider {index} has no orifices; with some: {sorted(rows)}")
        first, last = rows[index]
        return self.fields.orifices.read()[first:last, 6]

    def wall_impulse(self, side: str, about: np.ndarray | None = None) -> Wrench:
        """Return the impulse [N s], [N m s] that a wall received in the last advance.

        side: "x-", "x+", "y-", "y+", "z-" or "z+". about: point [m] (3,), or None: the world's origin. Raises
        UnknownName for another side.
        """
        if side not in SIDES:
            raise UnknownName("side", side, SIDES)
        return received(self.sums[self.fields.rows.walls + SIDES.index(side)], np.zeros(3) if about is None else about)

    def momentum_after_advance(self) -> Momentum:
        """Return the momentum after the last advance or load, summed in the kernel without a copy of the state."""
        if self._momentum is None:
            self._momentum = self.momentum()
        return self._momentum

    @property
    def contact_residual(self) -> float:
        """Largest residual of the contact solves of mobile colliders in the last advance; 0 without such colliders.

        Relative to the change of the collider's twist by contact. Above 0.01 `advance` warns.
        """
        return self.mobility.residual

    def momentum(self) -> Momentum:
        """Return the momentum of all particles, summed in float64."""
        return diagnostics.compute_momentum(self)

    def energy(self) -> Energy:
        """Return the energy of all particles, summed in float64; the elastic part is each law's own."""
        return diagnostics.compute_energy(self)

    def diagnostics(self) -> Diagnostics:
        """Return mass, momentum, energy, CFL number, and the numbers of escaped and non-finite particles."""
        return diagnostics.compute_diagnostics(self)

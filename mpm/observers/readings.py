"""What a solver can be asked for: its particles in double precision, their momentum and energy."""

import numpy as np

from mpm.observers import diagnostics
from mpm.observers.diagnostics import Diagnostics, Energy, Momentum
from mpm.scene.body import Body
from mpm.scene.grid import Grid
from mpm.state.assembly import AssemblyOwner
from mpm.state.fields import Fields
from mpm.state.particles import ParticleFields


class Readings(AssemblyOwner):
    """The part of a `Solver` that reads; each call copies what it needs from the fields."""

    bodies: list[Body]
    grid: Grid
    _momentum: Momentum

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

    def masses(self) -> np.ndarray:
        """Return masses [kg], shape (n_particles,)."""
        volume = self.particles.read([self.particles.volume])[:, 0].astype(float)
        return volume * np.repeat([b.material.density for b in self.bodies], self.particles.counts)

    def momentum_after_advance(self) -> Momentum:
        """Return the momentum after the last advance or load, summed in the kernel without a copy of the state."""
        return self._momentum

    def momentum(self) -> Momentum:
        """Return the momentum of all particles, summed in float64."""
        return diagnostics.compute_momentum(self)

    def energy(self) -> Energy:
        """Return the energy of all particles, summed in float64; the elastic part is each law's own."""
        return diagnostics.compute_energy(self)

    def diagnostics(self) -> Diagnostics:
        """Return mass, momentum, energy, CFL number, and the numbers of escaped and non-finite particles."""
        return diagnostics.compute_diagnostics(self)

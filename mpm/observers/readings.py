"""Arrays of a solver's particles, in double precision."""

import numpy as np

from mpm.scene.body import Body
from mpm.scene.grid import Grid
from mpm.state.particles import ParticleFields


class Readings:
    """The part of a `Solver` that reads its particles; each call copies what it needs from the fields."""

    particles: ParticleFields
    bodies: list[Body]
    grid: Grid

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

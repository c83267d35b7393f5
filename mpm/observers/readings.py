"""What can be read off a solver's grains, in double precision."""

import numpy as np

from mpm.scene.body import Body
from mpm.scene.grid import Grid
from mpm.state.particles import ParticleFields


class Readings:
    """The part of a `Solver` that looks at its grains as they are; each call copies what it needs from the fields."""

    particles: ParticleFields
    bodies: list[Body]
    grid: Grid

    def positions(self) -> np.ndarray:
        """[m], shape (n_particles, 3), float64, in the order of the bodies."""
        return self.particles.read(self.particles.x).astype(float) + self.grid.origin

    def velocities(self) -> np.ndarray:
        """[m/s], shape (n_particles, 3), float64."""
        return self.particles.read(self.particles.v).astype(float)

    def masses(self) -> np.ndarray:
        """[kg], shape (n_particles,)."""
        volume = self.particles.read([self.particles.volume])[:, 0].astype(float)
        return volume * np.repeat([b.material.density for b in self.bodies], self.particles.counts)

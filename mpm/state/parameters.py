"""Numbers that a scene may change without compiling anything: gravity, friction, material parameters."""

import numpy as np

from mpm.backend import put, real_type, ti
from mpm.scene.body import Body, Material
from mpm.scene.collider import Collider
from mpm.scene.grid import Grid
from mpm.scene.walls import Walls, wall_table

PARAMETERS = 8
"""Places for a law's numbers."""


class Numbers:
    """Run-time fields that the kernels read."""

    def __init__(
        self, bodies: list[Body], colliders: list[Collider], gravity: np.ndarray, walls: Walls, grid: Grid,
        precision: str,
    ) -> None:
        real = real_type(precision)
        dtype = np.float64 if precision == "f64" else np.float32
        self.parameters = ti.field(real, (len(bodies), PARAMETERS))
        """Parameters of each body's law."""
        self._laws, self._densities = np.zeros((len(bodies), PARAMETERS), dtype), np.zeros(len(bodies), dtype)
        self.densities = ti.field(real, len(bodies))
        """[kg/m^3] of each body."""
        self.frictions = ti.field(real, max(len(colliders), 1))
        """Coulomb coefficient of each collider."""
        self.half_thickness = ti.field(real, max(len(colliders), 1))
        """Half thickness [m] of each collider that is a shell."""
        self.zero = ti.field(real, ())
        """0, unknown to the compiler: a vector with a literal zero is taken apart into scalars (twice the time)."""
        self.gravity = ti.Vector.field(3, real, ())
        """[m/s^2]"""
        self.wall_friction = ti.field(real, ())
        """Coulomb coefficient of the walls."""
        for index, body in enumerate(bodies):
            self.set_law(index, body.material)
        put(self.frictions, np.array([c.friction for c in colliders] or [0.0], dtype))
        thickness = [getattr(c.sdf, "thickness", 0.0) for c in colliders] or [0.0]
        put(self.half_thickness, 0.5 * np.array(thickness, dtype))
        put(self.gravity, np.array(gravity, dtype))
        put(self.wall_friction, np.array(walls.friction, dtype))
        table = wall_table(walls, grid)
        self.walls = ti.field(ti.i32, table.shape)
        """The six sides, see `wall_table`."""
        put(self.walls, table)

    def set_law(self, index: int, material: Material) -> None:
        """Write a body's parameters."""
        self._laws[index, : len(material.parameters)] = material.parameters
        self._densities[index] = material.density
        put(self.parameters, self._laws)
        put(self.densities, self._densities)

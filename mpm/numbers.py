"""Numbers that a scene may change without compiling anything: gravity, friction, material parameters."""

import numpy as np

from mpm.backend import real_type, ti
from mpm.body import Body, Material
from mpm.collider import Collider

PARAMETERS = 8
"""Places for a law's numbers."""


class Numbers:
    """Run-time fields that the kernels read."""

    def __init__(
        self, bodies: list[Body], colliders: list[Collider], gravity: np.ndarray, wall_friction: float, precision: str
    ) -> None:
        real = real_type(precision)
        dtype = np.float64 if precision == "f64" else np.float32
        self.parameters = ti.field(real, (len(bodies), PARAMETERS))
        """Parameters of each body's law."""
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
        self.frictions.from_numpy(np.array([c.friction for c in colliders] or [0.0], dtype))
        thickness = [getattr(c.sdf, "thickness", 0.0) for c in colliders] or [0.0]
        self.half_thickness.from_numpy(0.5 * np.array(thickness, dtype))
        self.gravity[None] = [float(g) for g in gravity]
        self.wall_friction[None] = wall_friction

    def set_law(self, index: int, material: Material) -> None:
        """Write a body's parameters."""
        for i, value in enumerate(material.parameters):
            self.parameters[index, i] = value
        self.densities[index] = material.density

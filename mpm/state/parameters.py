"""Run-time parameters: gravity, friction and material numbers, which change without compiling anything."""

import numpy as np

from mpm.backend import check_owner, later, put, real_type, ti
from mpm.backend.launching import Launcher
from mpm.materials.material import PARAMETERS, Material
from mpm.materials.stable_step import isolated_modulus
from mpm.scene.body import Body
from mpm.scene.scene import Scene
from mpm.scene.wall_condition import WALL_PARAMETERS
from mpm.scene.walls import WALL_COLUMNS, WALL_COUNT, wall_numbers, wall_table


def laws_of(bodies: list[Body]) -> list[Material]:
    """Return a material of each law in a scene, in the order of the bodies: what is compiled once a law."""
    return list({type(body.material): body.material for body in reversed(bodies)}.values())[::-1]


@ti.data_oriented
class Parameters:
    """Run-time fields that the kernels read."""

    def __init__(self, n_bodies: int, n_colliders: int, precision: str) -> None:
        real = real_type(precision)
        dtype = np.float64 if precision == "f64" else np.float32
        self.law = ti.field(real, (n_bodies, PARAMETERS))  # parameters of each body's law
        self.law_index = ti.field(ti.i32, n_bodies)  # place of each body's law among the scene's laws
        self._write = Launcher(self, Parameters._write_numbers)
        self._laws = np.zeros((n_bodies, PARAMETERS), dtype)
        self._densities, self._moduli = np.zeros((2, n_bodies), dtype)
        self._frictions = np.zeros(max(n_colliders, 1), dtype)
        self.densities = ti.field(real, n_bodies)  # [kg/m^3] of each body
        self.moduli = ti.field(real, n_bodies)  # `isolated_modulus` [Pa] of each body
        self.frictions = ti.field(real, max(n_colliders, 1))  # Coulomb coefficient of each collider
        self.half_thickness = ti.field(real, max(n_colliders, 1))  # half thickness [m] of each collider that is a shell
        self.zero = ti.field(real, ())
        """0, unknown to the compiler: a vector with a literal zero is taken apart into scalars (twice the time)."""
        self.gravity = ti.Vector.field(3, real, ())  # [m/s^2]
        self.wall_numbers = ti.Vector.field(WALL_PARAMETERS, real, WALL_COUNT)
        """Numbers of each side's condition, in the order of folding."""
        self.walls = ti.field(ti.i32, (WALL_COUNT, WALL_COLUMNS))  # the six sides, see `wall_table`

    def fill(self, scene: Scene) -> None:
        """Write the numbers of a scene."""
        bodies, colliders = scene.bodies, scene.colliders
        kinds = [type(law) for law in laws_of(bodies)]
        put(self.law_index, np.array([kinds.index(type(body.material)) for body in bodies], np.int32))
        self._laws[:] = 0.0
        self._frictions[:] = [c.friction for c in colliders] or [0.0]
        for index, body in enumerate(bodies):
            self.set_law(index, body.material)
        dtype = self._laws.dtype
        thickness = [c.sdf.thickness for c in colliders] or [0.0]
        put(self.half_thickness, 0.5 * np.array(thickness, dtype))
        put(self.gravity, np.array(scene.gravity, dtype))
        put(self.wall_numbers, wall_numbers(scene.walls).astype(dtype))
        put(self.walls, wall_table(scene.walls, scene.grid))

    def set_law(self, index: int, material: Material) -> None:
        """Write the parameters and the density of a body's law."""
        check_owner()
        self._laws[index, : len(material.parameters)] = material.parameters
        self._densities[index] = material.density
        self._moduli[index] = isolated_modulus(material.mu, material.lam)
        self._launch()

    def set_friction(self, index: int, friction: float) -> None:
        """Write the Coulomb coefficient of a collider."""
        check_owner()
        self._frictions[index] = friction
        self._launch()

    def _launch(self) -> None:
        later(lambda: self._write(self._laws, self._densities, self._moduli, self._frictions))

    @ti.kernel
    def _write_numbers(self, laws: ti.types.ndarray(), densities: ti.types.ndarray(), moduli: ti.types.ndarray(),
                       frictions: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for body in range(densities.shape[0]):
            for i in ti.static(range(PARAMETERS)):
                self.law[body, i] = laws[body, i]
            self.densities[body], self.moduli[body] = densities[body], moduli[body]
        ti.loop_config(serialize=True)
        for index in range(frictions.shape[0]):
            self.frictions[index] = frictions[index]

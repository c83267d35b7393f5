"""What can be set in a scene that stands: numbers that kernels read, so that nothing is compiled again."""

from typing import Any

import numpy as np

from mpm.errors import InvalidValue
from mpm.materials.material import Material
from mpm.materials.stable_step import check_step, material_bound
from mpm.observers.diagnostics import Momentum
from mpm.observers.readings import Readings
from mpm.scene.body import half_edge, with_material, with_volume
from mpm.scene.collider import Collider, with_friction
from mpm.scene.validation import check_finite
from mpm.stepping.sleep_thresholds import sleep_limits


class Adjustable(Readings):
    """The part of a `Solver` that sets numbers of its scene."""

    colliders: list[Collider]
    gravity: np.ndarray
    dt: float
    bound: float
    sleep: float
    rollback: Any
    _momentum: Momentum | None

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Set gravity [m/s^2] (3,); wakes all particles."""
        self.fields.parameters.gravity[None] = self.gravity = check_finite("set_gravity", gravity, (3,))
        self.wake()

    def set_friction(self, index: int, friction: float) -> None:
        """Set the friction coefficient of a collider, without recompilation."""
        self.paths.pose(index)
        changed = with_friction(self.colliders[index], friction)
        self.fields.parameters.set_friction(index, friction)
        self.colliders[index] = changed
        self.wake()

    def set_material(self, index: int, material: Material) -> None:
        """Set other parameters of a body's law, without recompilation; raises TimeStepTooLarge if dt is too large."""
        self.check_material(index, material)
        old = self.bodies[index].material
        self.fields.parameters.set_law(index, material)
        self.bodies[index] = with_material(self.bodies[index], material)
        self.bound = min(material_bound(self.grid.cell, body.material) for body in self.bodies)
        self._momentum = None if material.density != old.density else self._momentum
        if material != old:
            self.wake()

    def check_material(self, index: int, material: Material) -> None:
        """Raise InvalidValue or TimeStepTooLarge if `set_material` would not accept this material."""
        accepted = type(self.bodies[index].material)
        if type(material) is not accepted:
            raise InvalidValue(f"set_material: {type(material).__name__}; accepted: {accepted.__name__}")
        rates = [getattr(law, "volume_rate", "") for law in (material, self.bodies[index].material)]
        if rates[0] != rates[1]:
            raise InvalidValue(f"set_material: volume_rate = {rates[0]!r}; accepted: {rates[1]!r}, that of the scene")
        check_step(self.dt, self.grid.cell, [material])

    def set_volume(self, index: int, volume: float) -> None:
        """Set the initial volume [m^3] of every particle of a body, without recompilation.

        Particles stay where they are. Raises InvalidValue.
        """
        changed = with_volume(self.bodies[index], volume)
        self.particles.volumes.set(index, volume, half_edge(volume))
        self.bodies[index] = changed
        self._momentum = None
        self.wake()

    def wake(self) -> None:
        """Wake all particles; does nothing without sleeping."""
        if self.fields.sleepers is not None:
            self.fields.sleepers.set_limits(sleep_limits(self.sleep, self.grid, self.bodies, self.gravity))
            self.rollback.store_pending()
            self.particles.write([self.particles.rest], np.zeros((sum(self.particles.counts), 1)))
            self.fields.substep_counter.is_listed = False

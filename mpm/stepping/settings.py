"""Settings of a scene that stands: numbers that kernels read, so that nothing is compiled again."""

import numpy as np

from mpm.errors import InvalidValue
from mpm.materials.material import Material
from mpm.materials.stable_step import check_step, material_bound
from mpm.observers.readings import Readings
from mpm.scene.body import Body, half_edge, largest_volume, with_volume
from mpm.scene.collider import check_friction
from mpm.scene.validation import check_finite, with_values
from mpm.stepping.rollback import Rollback
from mpm.stepping.sleep_thresholds import sleep_limits


class Settings:
    """Functions of a solver's fields that set them. dt: largest substep [s]. sleep: factor on the thresholds, or 0."""

    def __init__(self, readings: Readings, rollback: Rollback, dt: float, sleep: float) -> None:
        self._readings, self._rollback, self._dt, self._sleep = readings, rollback, dt, sleep
        self._scene, self._progress = readings.scene, readings.progress
        self.bound = self._find_bound()  # of the substep [s], of which parts are accepted

    def _find_bound(self) -> float:
        volume = largest_volume(self._scene.bodies)
        return min(material_bound(self._scene.grid.cell, body.material, 1.0, volume) for body in self._scene.bodies)

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Set gravity [m/s^2] (3,); wakes all particles."""
        checked = check_finite("set_gravity", gravity, (3,))
        self._readings.fields.parameters.gravity[None] = checked  # first: another thread is refused here
        self._scene.gravity = checked
        self.wake()

    def set_friction(self, index: int, friction: float) -> None:
        """Set the friction coefficient of a collider."""
        colliders = self._scene.colliders
        if not 0 <= index < len(colliders):
            raise InvalidValue(f"collider {index}; accepted: 0 to {len(colliders) - 1}, as the scene has them")
        check_friction(friction)
        self._readings.fields.parameters.set_friction(index, friction)
        colliders[index] = with_values(colliders[index], friction=friction)
        self.wake()

    def set_material(self, index: int, material: Material) -> None:
        """Set other parameters of a body's law; raises TimeStepTooLarge if dt is too large."""
        self.check_material(index, material)
        old = self._scene.bodies[index].material
        self._readings.fields.parameters.set_law(index, material)
        self._scene.bodies[index] = with_values(self._scene.bodies[index], material=material)
        self.bound = self._find_bound()
        if material.density != old.density:
            self._progress.momentum = None
        if material != old:
            self.wake()

    def check_material(self, index: int, material: Material) -> None:
        """Raise InvalidValue or TimeStepTooLarge if `set_material` would not accept this material."""
        old = self._scene.bodies[index].material
        if type(material) is not type(old):
            raise InvalidValue(f"set_material: {type(material).__name__}; accepted: {type(old).__name__}")
        rates = [getattr(law, "volume_rate", "") for law in (material, old)]
        if rates[0] != rates[1]:
            raise InvalidValue(f"set_material: volume_rate = {rates[0]!r}; accepted: {rates[1]!r}, that of the scene")
        check_step(self._dt, self._scene.grid.cell, [material], volume=largest_volume(self._scene.bodies))

    def set_volume(self, index: int, volume: float) -> None:
        """Set the initial volume [m^3] of every particle of a body; particles stay where they are.
        Raises InvalidValue, and TimeStepTooLarge if dt is too large: of sand, for grains of half a cell and more."""
        changed = self.check_volume(index, volume)
        self._readings.particles.volumes.set(index, volume, half_edge(volume))
        self._scene.bodies[index] = changed
        self.bound = self._find_bound()
        self._progress.momentum = None
        self.wake()

    def check_volume(self, index: int, volume: float) -> Body:
        """Return a body as `set_volume` makes it; raises what that raises."""
        bodies = list(self._scene.bodies)
        bodies[index] = with_volume(bodies[index], volume)
        check_step(self._dt, self._scene.grid.cell, [body.material for body in bodies], volume=largest_volume(bodies))
        return bodies[index]

    def wake(self) -> None:
        """Wake all particles; does nothing without sleeping."""
        fields = self._readings.fields
        if fields.sleepers is not None:
            fields.sleepers.set_limits(sleep_limits(self._sleep, self._scene))
            self._rollback.store_pending()
            fields.particles.write([fields.particles.rest], np.zeros((sum(fields.particles.counts), 1)))
            fields.substep_counter.is_listed = False

"""Numbers of a scene that may differ between the environments of a batch, in one table for its kernel."""

from typing import Any

import numpy as np

from mpm.backend import ti
from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import Pose, check_pose
from mpm.materials.material import PARAMETERS, Material
from mpm.materials.stable_step import isolated_modulus
from mpm.observers.counter_kernel import FRAME, FRAME_NUMBERS, CounterKernel
from mpm.observers.region_counter import RegionCounter
from mpm.scene.body import half_edge
from mpm.state.fields import Fields
from mpm.stepping.core import Core

BODY_NUMBERS = PARAMETERS + 4
DENSITY, MODULUS, VOLUME, HALF = range(PARAMETERS, BODY_NUMBERS)  # places of a body's numbers beside its law's


class EnvironmentNumbers:
    """The table (n, numbers), float64: of each body, each collider's friction, and the counter's frame."""

    def __init__(self, core: Core, n: int) -> None:
        self._bodies, self._colliders = len(core.scene.bodies), len(core.scene.colliders)
        self.frictions = self._bodies * BODY_NUMBERS
        self.frame = self.frictions + self._colliders
        self.table = np.zeros((n, self.frame + FRAME_NUMBERS))
        self.materials = [[body.material for body in core.scene.bodies] for _ in range(n)]
        self._volumes = [[body.volume for body in core.scene.bodies] for _ in range(n)]
        self.has_volumes = False
        """Whether an environment has been given volumes of its own; until then the kernel writes none."""
        self._frames = [Pose.identity()] * n
        for e in range(n):
            self.adopt(e, core)

    def adopt(self, e: int, core: Core) -> None:
        """Take over the solver's own numbers in an environment."""
        for index, body in enumerate(core.scene.bodies):
            self.set_material(e, index, body.material)
            if np.size(body.volume) == 1 and body.volume != self._volumes[e][index]:
                self.set_volume(e, index, body.volume)
        self.table[e, self.frictions : self.frame] = [collider.friction for collider in core.scene.colliders]
        if core.counter is not None:
            self.set_frame(e, core.counter, core.counter.frame)

    def hand_over(self, e: int, core: Core) -> None:
        """Set the solver's numbers, and the fields, which are those of the last launch, to those of an environment."""
        for index, material in enumerate(self.materials[e]):
            core.settings.set_material(index, material)
            if self.has_volumes and np.size(self._volumes[e][index]) == 1:
                core.settings.set_volume(index, self._volumes[e][index])
        for index in range(self._colliders):
            core.settings.set_friction(index, float(self.table[e, self.frictions + index]))
        if core.counter is not None:
            core.counter.place(self._frames[e])

    def set_material(self, e: int, index: int, material: Material) -> None:
        """Set a body's material."""
        self.materials[e][index] = material
        own = self.table[e, index * BODY_NUMBERS : (index + 1) * BODY_NUMBERS]
        own[:PARAMETERS] = 0.0
        own[: len(material.parameters)] = material.parameters
        own[DENSITY], own[MODULUS] = material.density, isolated_modulus(material.mu, material.lam)

    def set_volume(self, e: int, index: int, volume: Any) -> None:
        """Set the volume [m^3] of each of a body's particles."""
        self._volumes[e][index], self.has_volumes = volume, True
        for own, volumes in zip(self.table, self._volumes):
            for body, each in enumerate(volumes):
                if np.size(each) == 1:  # volumes of single particles stay as they are
                    first = body * BODY_NUMBERS
                    own[[first + VOLUME, first + HALF]] = float(each), half_edge(float(each))

    def set_frame(self, e: int, counter: RegionCounter, frame: Pose) -> None:
        """Set the frame of the counter's regions."""
        self._frames[e] = check_pose("Batch: frame", frame)
        self.table[e, self.frame :] = counter.frame_numbers(frame)

    def set_friction(self, e: int, index: int, friction: float) -> bool:
        """Set a collider's friction; return whether it is another one."""
        if not 0 <= index < self._colliders:
            raise InvalidValue(f"Batch: collider {index}; accepted: 0 to {self._colliders - 1}")
        before, self.table[e, self.frictions + index] = self.table[e, self.frictions + index], friction
        return bool(before != friction)


@ti.data_oriented
class NumbersKernel:
    """Writes an environment's numbers to the fields that the phases read."""

    def __init__(self, fields: Fields, counter: CounterKernel | None, n_colliders: int) -> None:
        self.parameters, self.counter, self.n_colliders = fields.parameters, counter, n_colliders
        self.volumes, self.ranges = fields.particles.volumes, fields.particles.range_table
        self.has_counter = counter is not None

    @ti.func
    def write(self, table: ti.template(), e):
        """Write the numbers of environment e."""
        bodies = self.parameters.densities.shape[0]
        for body in range(bodies):
            first = body * ti.static(BODY_NUMBERS)
            for i in ti.static(range(PARAMETERS)):
                self.parameters.law[body, i] = ti.cast(table[e, first + i], self.parameters.law.dtype)
            self.parameters.densities[body] = ti.cast(table[e, first + ti.static(DENSITY)],
                                                      self.parameters.densities.dtype)
            self.parameters.moduli[body] = ti.cast(table[e, first + ti.static(MODULUS)], self.parameters.moduli.dtype)
            if table[e, first + ti.static(VOLUME)] > 0.0:
                begin, end, _ = self.ranges[body]
                for q in range(begin, end):
                    self.volumes.write_pack(q, table[e, first + ti.static(VOLUME)], table[e, first + ti.static(HALF)])
        for i in range(ti.static(self.n_colliders)):
            self.parameters.frictions[i] = ti.cast(table[e, bodies * ti.static(BODY_NUMBERS) + i],
                                                   self.parameters.frictions.dtype)
        if ti.static(self.has_counter):
            first = bodies * ti.static(BODY_NUMBERS) + ti.static(self.n_colliders)
            for i in ti.static(range(FRAME_NUMBERS)):
                self.counter.numbers[ti.static(FRAME) + i] = table[e, first + i]

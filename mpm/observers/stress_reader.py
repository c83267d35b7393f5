"""Stress of all particles, computed by their laws from the state that the fields hold."""

import numpy as np

from mpm.backend import is_shared, once, ti
from mpm.materials.material import PARAMETERS
from mpm.materials.stress_update import current_stress
from mpm.materials.symmetric_tensor import FULL
from mpm.state.fields import Fields
from mpm.state.packs import LANES


@ti.data_oriented
class StressReader:
    """What reading stresses compiles for a scene."""

    def __init__(self, fields: Fields) -> None:
        self.fields, self.on_gpu = fields, is_shared()

    def read(self) -> np.ndarray:
        """Return the Kirchhoff stress [Pa] of all particles, shape (n_particles, 3, 3)."""
        particles = self.fields.particles
        packed = np.zeros((6, particles.n_packs, LANES), self.fields.dtype)
        self._read(packed)
        return particles.unpack(packed)[:, list(FULL)].reshape(-1, 3, 3).astype(float)

    @ti.kernel
    def _read(self, out: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for q in range(self.fields.particles.pack_count[None]):
            for body in range(self.fields.parameters.densities.shape[0]):
                ends = self.fields.particles.range_table[body]
                if ends[0] <= q and q < ends[1]:
                    for index, law in ti.static(enumerate(self.fields.laws)):
                        if self.fields.parameters.law_index[body] == index:
                            p = [once(self.fields.parameters.law[body, i]) for i in range(PARAMETERS)]
                            tau = current_stress(self.fields, self.fields.particles, law, q, p)
                            for i in ti.static(range(6)):
                                for l in ti.static(range(LANES)):
                                    out[i, q, l] = tau[i][l]

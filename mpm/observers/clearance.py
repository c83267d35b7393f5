"""How far a collider is from the particles: what a host asks to know whether they can touch."""

import numpy as np

from mpm.backend import is_shared, ti
from mpm.geometry.rigid_motion import Pose
from mpm.geometry.shell import SHELL_FACE
from mpm.state.fields import Fields
from mpm.state.packs import LANES
from mpm.state.sleepers import AHEAD

STENCIL = 1.5 * 3**0.5
"""Cells from a particle to the farthest node that it gives mass to."""


def reach_of(fields: Fields) -> float:
    """Return the distance [m] of particles from a collider beyond which neither knows of the other in a substep.
    Contact acts at nodes up to `SHELL_FACE` cells from a surface; what sleeps wakes `AHEAD` of it."""
    return (STENCIL + SHELL_FACE + (AHEAD if fields.features.sleep else 0.0)) * fields.cell


@ti.data_oriented
class ClearanceKernel:
    """What reading the clearance of one collider compiles for a scene."""

    def __init__(self, fields: Fields, index: int) -> None:
        self.fields, self.index, self.on_gpu = fields, index, is_shared()
        self.nearest = ti.field(fields.real, ())

    def read(self, pose: Pose) -> float:
        """Return a lower bound [m] of the distance of the nearest particle from the collider at a pose."""
        origin = np.asarray(self.fields.origin)
        self._read(np.concatenate([pose.position - origin, pose.matrix.ravel()]).astype(self.fields.dtype))
        return float(self.nearest[None])

    @ti.kernel
    def _read(self, pose: ti.types.ndarray()):
        self.nearest[None] = 1e6
        ti.loop_config(serialize=not self.on_gpu)
        for q in range(self.fields.particles.pack_count[None]):
            self._look_at_pack(self.fields.particles, self.fields.colliders[self.index].sdf, pose, q)

    @ti.func
    def _look_at_pack(self, P: ti.template(), sdf: ti.template(), pose: ti.template(), q):
        c = ti.Vector([pose[d] for d in range(3)])
        R = ti.Matrix([[pose[3 + 3 * i + j] for j in range(3)] for i in range(3)])
        for l in ti.static(range(LANES)):
            r = ti.Vector([P.x[d][q][l] for d in range(3)]) - c
            if P.volume[q][l] > 0.0 and r.norm() - sdf.radius < self.nearest[None]:
                ti.atomic_min(self.nearest[None], sdf.least_distance(R.transpose() @ r))

"""Fields that contact needs: static colliders and shells at nodes, particles at shells, nodes at mobile colliders."""

import numpy as np

from mpm.backend import real_type, ti
from mpm.scene.grid import BLOCK, Grid

TOLERANCE = {"f32": 1e-5, "f64": 1e-11}
"""Error at which a contact solve ends, relative to the change of twist by contact."""


class StaticContact:
    """The colliders that never move, looked up once at every node."""

    def __init__(self, grid: Grid, precision: str) -> None:
        self.plane = ti.Vector.field(4, real_type(precision), grid.shape)
        """Normal and signed distance [m] of the collider that owns the node."""
        self.owner = ti.field(ti.i32, grid.shape)
        """Index plus one of the collider whose contact the node takes; 0: none."""
        self.owned = ti.field(ti.i32, tuple(n // BLOCK for n in grid.shape))
        """1 where a node of the block has an owner."""


class ShellFields:
    """Sides of nodes, and the list of the particles with a side, in the order of the packs."""

    def __init__(self, grid: Grid, precision: str, n_particles: int) -> None:
        real = real_type(precision)
        self.side = ti.field(ti.i32, grid.shape)
        """Plus or minus the closest shell's collider index plus one, by side; 0 beyond its rim and far from any."""
        self.shell = ti.field(ti.i32, grid.shape)
        """The closest shell's collider index plus one, beyond the rim too; 0 far from any."""
        self.gap = ti.Vector.field(4, real, grid.shape)
        """Normal towards the positive side and signed distance [m]."""
        self.labelled = ti.field(ti.i32, tuple(n // BLOCK for n in grid.shape))
        """Whether a block's nodes hold labels."""
        self.count = ti.field(ti.i32, ())
        """Particles on the list."""
        self.slot = ti.Vector.field(2, ti.i32, n_particles)
        """Pack and lane."""
        self.base = ti.Vector.field(3, ti.i32, n_particles)
        """First node of the stencil."""
        self.offset = ti.Vector.field(3, real, n_particles)
        """Offset from it in cells."""
        self.mass = ti.field(real, n_particles)
        """[kg]"""
        self.q = [ti.Vector.field(4, real, n_particles) for _ in range(4)]
        """Momentum and mass, and the columns of the affine momentum per cell."""

    def fill(self) -> None:
        """Forget all labels."""
        for field in (self.side, self.shell, self.labelled):
            field.fill(0)


class MobileContact:
    """The nodes that each mobile collider touches in this substep, and room for six equations."""

    def __init__(self, capacities: list[int], precision: str) -> None:
        real = real_type(precision)
        self.tolerance = TOLERANCE[precision]
        ends = np.cumsum(capacities)
        self.first = [int(end - n) for end, n in zip(ends, capacities)]
        """First place of each collider in the lists."""
        self.count = ti.field(ti.i32, len(capacities))
        """Nodes on each collider's list."""
        self.node = ti.Vector.field(3, ti.i32, int(ends[-1]))
        self.normal = ti.Vector.field(3, real, int(ends[-1]))
        """Out of the collider, in world axes."""
        self.slope = ti.field(ti.f64, (6, 6))
        """Derivative of the impulse on the nodes by the collider's twist."""
        self.system = ti.field(ti.f64, (6, 7))
        """Newton's equations, the right-hand side in the last column."""

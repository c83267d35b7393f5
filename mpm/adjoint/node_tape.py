"""Adjoints of the particles' state, and the grid's nodes in every substep of one stride, recorded for the adjoint."""

import numpy as np

from mpm.backend import real_type, ti
from mpm.scene.grid import BLOCK
from mpm.state.nodes import GridFields, node_of
from mpm.state.packs import LANES, Packs
from mpm.state.particles import ParticleFields


class ParticleAdjoints:
    """A field for the adjoint of every field of the state, under the same names, zero at first.
    The remainder has none: it is part of the position, whose derivative does not know the resolution."""

    def __init__(self, particles: ParticleFields, precision: str) -> None:
        self._named = {name: [ti.Vector.field(LANES, real_type(precision), particles.n_packs) for _ in fields]
                       for name, fields in particles.named_fields().items() if name != "remainder"}
        self.x, self.v, self.C = (self._named[name] for name in ("x", "v", "C"))
        self.e = self._named.get("e", [])
        self.j, self.vc, self.around, self.noted = (self._named.get(name, [None])[0]
                                                    for name in ("j", "vc", "around", "noted"))
        every = [field for fields in self._named.values() for field in fields]
        self.packs = Packs(every, particles.pack_count, np.float64 if precision == "f64" else np.float32)

    def named_fields(self) -> dict[str, list]:
        """Return the fields by the names of `ParticleFields`."""
        return self._named


@ti.data_oriented
class NodeTape:
    """Nodes of up to `depth` substeps."""

    def __init__(self, grid: GridFields, precision: str, depth: int) -> None:
        real, shape = real_type(precision), grid.nodes.shape
        self.folded = ti.Vector.field(4, real, (depth, *shape))  # momentum and mass, after the walls' images were added
        self.velocities = ti.Vector.field(4, real, (depth, *shape))  # velocity and mass at the end of the substep
        self.bars = ti.Vector.field(4, real, shape)  # adjoints of velocity, or momentum, and mass
        self.mass_bars = ti.field(real, shape)  # what contact later in a stride adds to those of the first substep

    @ti.func
    def mass(self, fields: ti.template(), J):
        """Return the mass [kg] of a node in the first substep, by which contact is decided for a stride."""
        return self.folded[0, J[0], J[1], J[2]][3]

    @ti.func
    def record(self, grid: ti.template(), place: ti.template(), k):
        """Copy the nodes of active blocks to entry k of `folded` or `velocities`."""
        for n in range(grid.count[None]):
            for m in range(BLOCK**3):
                I = node_of(grid.active[n], m)
                place[k, I[0], I[1], I[2]] = grid.nodes[I]

    @ti.func
    def restore(self, grid: ti.template(), k):
        """Set the nodes of active blocks to the velocities of substep k."""
        for n in range(grid.count[None]):
            for m in range(BLOCK**3):
                I = node_of(grid.active[n], m)
                grid.nodes[I] = self.velocities[k, I[0], I[1], I[2]]

    @ti.func
    def clear_bars(self, grid: ti.template()):
        """Zero the adjoints of the nodes of active blocks: what follows the stride does not depend on them."""
        for n in range(grid.count[None]):
            for m in range(BLOCK**3):
                self.bars[node_of(grid.active[n], m)] = ti.Vector.zero(grid.nodes.dtype, 4)
                self.mass_bars[node_of(grid.active[n], m)] = 0.0

    @ti.func
    def add_mass_bars(self, grid: ti.template()):
        """Add the adjoints of masses by which contact was decided for the later substeps of the stride."""
        for n in range(grid.count[None]):
            for m in range(BLOCK**3):
                I = node_of(grid.active[n], m)
                self.bars[I][3] += self.mass_bars[I]


@ti.func
def start_nodes_back(a: ti.template(), step: ti.template()):
    """Adjoint of `start_nodes`: from the adjoints of momenta to those of the previous substep's velocities."""
    if step.place > 0:
        for n in range(a.fields.grid.count[None]):
            block = a.fields.grid.active[n] * BLOCK
            for i, j in ti.ndrange(BLOCK, BLOCK):
                for k in ti.static(range(BLOCK)):
                    I = block + ti.Vector([i, j, k])
                    q, bar = a.nodes.velocities[step.place - 1, I[0], I[1], I[2]], a.nodes.bars[I]
                    mass_bar = bar[3] + q[0] * bar[0] + q[1] * bar[1] + q[2] * bar[2]
                    a.nodes.bars[I] = ti.Vector([q[3] * bar[0], q[3] * bar[1], q[3] * bar[2], mass_bar])

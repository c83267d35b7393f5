"""The grid's nodes in every substep of one stride, recorded for the adjoint."""

from mpm.backend import real_type, ti
from mpm.scene.grid import BLOCK
from mpm.state.nodes import GridFields


@ti.data_oriented
class NodeTape:
    """Nodes of up to `depth` substeps."""

    def __init__(self, grid: GridFields, precision: str, depth: int) -> None:
        real, shape = real_type(precision), grid.nodes.shape
        self.folded = ti.Vector.field(4, real, (depth, *shape))
        """Momentum and mass, after the walls' images were added."""
        self.velocities = ti.Vector.field(4, real, (depth, *shape))
        """Velocity and mass at the end of the substep."""
        self.bars = ti.Vector.field(4, real, shape)
        """Adjoints of velocity, or momentum, and mass."""

    @ti.func
    def mass(self, fields: ti.template(), k, J):
        """Return the mass [kg] of a node in substep k, as contact sees it."""
        return self.folded[k, J[0], J[1], J[2]][3]

    @ti.func
    def record(self, grid: ti.template(), place: ti.template(), k):
        """Copy the nodes of active blocks to entry k of `folded` or `velocities`."""
        for n in range(grid.count[None]):
            block = grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block + ti.Vector([a, b, c])
                    place[k, I[0], I[1], I[2]] = grid.nodes[I]

    @ti.func
    def restore(self, grid: ti.template(), k):
        """Set the nodes of active blocks to the velocities of substep k."""
        for n in range(grid.count[None]):
            block = grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block + ti.Vector([a, b, c])
                    grid.nodes[I] = self.velocities[k, I[0], I[1], I[2]]

    @ti.func
    def clear_bars(self, grid: ti.template()):
        """Zero the adjoints of the nodes of active blocks: what follows the stride does not depend on them."""
        for n in range(grid.count[None]):
            block = grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    self.bars[block + ti.Vector([a, b, c])] = ti.Vector.zero(grid.nodes.dtype, 4)


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

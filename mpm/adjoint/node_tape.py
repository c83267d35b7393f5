"""The grid's nodes in every substep of one stride, kept for the way back."""

from mpm.backend import real_type, ti
from mpm.scene.grid import BLOCK, Grid


@ti.data_oriented
class NodeTape:
    """Nodes of up to `depth` substeps."""

    def __init__(self, grid: Grid, precision: str, depth: int) -> None:
        real = real_type(precision)
        self.folded = ti.Vector.field(4, real, (depth, *grid.shape))
        """Momentum and mass, after the walls' images were added."""
        self.velocities = ti.Vector.field(4, real, (depth, *grid.shape))
        """Velocity and mass at the end of the substep."""
        self.bars = ti.Vector.field(4, real, grid.shape)
        """Of velocity, or momentum, and mass."""

    @ti.func
    def keep(self, grid: ti.template(), kept: ti.template(), k):
        """Copy the nodes of active blocks to place k of `folded` or `velocities`."""
        for n in range(grid.count[None]):
            block = grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block + ti.Vector([a, b, c])
                    kept[k, I[0], I[1], I[2]] = grid.nodes[I]

    @ti.func
    def bring(self, grid: ti.template(), k):
        """Give the nodes of active blocks the velocities of substep k."""
        for n in range(grid.count[None]):
            block = grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block + ti.Vector([a, b, c])
                    grid.nodes[I] = self.velocities[k, I[0], I[1], I[2]]

    @ti.func
    def clear_bars(self, grid: ti.template()):
        """Nothing after the stride has seen the nodes."""
        for n in range(grid.count[None]):
            block = grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    self.bars[block + ti.Vector([a, b, c])] = ti.Vector.zero(grid.nodes.dtype, 4)

    @ti.func
    def hold_back(self, grid: ti.template(), k):
        """Adjoint of `hold`: bars of the momenta that substep k + 1 began with to those of substep k's velocities."""
        for n in range(grid.count[None]):
            block = grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block + ti.Vector([a, b, c])
                    q, bar = self.velocities[k, I[0], I[1], I[2]], self.bars[I]
                    mass_bar = bar[3] + q[0] * bar[0] + q[1] * bar[1] + q[2] * bar[2]
                    self.bars[I] = ti.Vector([q[3] * bar[0], q[3] * bar[1], q[3] * bar[2], mass_bar])

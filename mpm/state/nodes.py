"""Node values of the background grid, in blocks, and the nodes that a particle's stencil begins with."""

import numpy as np

from mpm.backend import once, real_type, ti
from mpm.scene.grid import BLOCK, Grid


class GridFields:
    """Node values and the list of active blocks.
    With `layers` = 2 every node exists twice, the second time `width` places farther along x: material that a thin
    shell separates from a node meets the shell there, in a velocity field of its own (see `shell_sides`)."""

    def __init__(self, grid: Grid, precision: str, layers: int = 1, lists: bool = True, parts: int = 0,
                 solids: int = 0, moving_solids: int = 0) -> None:
        real = real_type(precision)
        nx, ny, nz = grid.shape
        self.layers, self.width, self.cell = layers, nx, grid.cell
        self.lists = lists
        """Whether marking a block also lists it: one thread can, several list blocks in a phase of its own."""
        self.cells = tuple(int(n) for n in grid.cells)
        self.nodes = ti.Vector.field(4, real, (layers * nx, ny, nz))
        """(momentum, mass) after the scatter, (velocity, mass) after the grid update."""
        self.touching = ti.field(ti.i32, (solids, layers * nx, ny, nz)) if solids else None
        """Number of the first substep of the stride in which the node's material last touched a solid.
        A row for each solid that moves, and a last one for all that are static."""
        self.face = ti.Vector.field(4, real, (moving_solids, layers * nx, ny, nz)) if moving_solids else None
        """Normal of the face of a moving solid that the node's material touches in the stride; and 1 where it is that
        of the material's surface, 0 where it is the solid's own."""
        blocks = (layers * nx // BLOCK, ny // BLOCK, nz // BLOCK)
        self.contact = ti.field(ti.i32, blocks) if solids or layers == 2 else None
        """What nodes of the block touch in the stride, see `find_contact`."""
        self.stamp = ti.field(ti.i32, blocks)  # number of the substep in which the block was last active
        self.reached = ti.field(ti.i32, (parts, *blocks)) if parts else None
        """Number of the substep for which a part of the packs last scattered to the block."""
        self.rows = None if lists else ti.field(ti.i32, blocks[:2])
        """Number of the substep in which a block of the row was last active."""
        self.seed = ti.Vector.field(2, ti.i32, blocks)
        """Substep in which a stencil last started in the block, and bits for the faces that stencils reach over; where
        marking does not list, the substep for which it was listed."""
        self.active = ti.Vector.field(3, ti.i32, int(np.prod(blocks)))  # indices of the active blocks
        self.count = ti.field(ti.i32, ())  # number of active blocks


@ti.func
def in_first_layer(grid: ti.template(), I):
    """Return the node (3,) of the first layer at the same place."""
    J = I
    if ti.static(grid.layers == 2):
        J[0] = I[0] % grid.width
    return J


@ti.func
def first_nodes(grid: ti.template(), x: ti.template(), q, inverse_cell):
    """Return the first nodes of the stencils of pack q (three integer packs), and the offsets from them in cells.
    Offsets lie in [0.5, 1.5). Nodes stay inside the array even when a position is not finite."""
    return stencil(grid, [once(x[d][q] * inverse_cell) for d in range(3)])


@ti.func
def stencil(grid: ti.template(), scaled: ti.template()):
    """Return first nodes and offsets at three coordinates in cells, packs or single numbers."""
    floors = [once(ti.floor(scaled[d] - 0.5)) for d in range(3)]
    last = ti.static((grid.width - 3, grid.nodes.shape[1] - 3, grid.nodes.shape[2] - 3))
    nodes = [once(ti.max(ti.min(ti.cast(floors[d], ti.i32), last[d]), 0)) for d in range(3)]
    return nodes, [once(scaled[d] - floors[d]) for d in range(3)]


@ti.func
def node_of(block, number):
    """Return a node (3,), 0 to 63, of a block."""
    return block * BLOCK + ti.Vector([number // BLOCK**2, number // BLOCK % BLOCK, number % BLOCK])


@ti.func
def clear(grid: ti.template(), step: ti.template(), first, last):
    """Zero the nodes of the active blocks first .. last - 1."""
    for n in range(first, last):
        corner = grid.active[n] * BLOCK
        if ti.static(step.threads > 1):
            grid.nodes[node_of(grid.active[n], step.thread)] = ti.Vector.zero(grid.nodes.dtype, 4)
        else:
            for a in range(BLOCK):
                for c in range(BLOCK):
                    for d in ti.static(range(BLOCK)):
                        grid.nodes[corner + ti.Vector([a, c, d])] = ti.Vector.zero(grid.nodes.dtype, 4)


@ti.func
def velocities_to_momenta(grid: ti.template(), step: ti.template(), first, last):
    """Turn the velocities of the previous substep back to momenta, in the active blocks first .. last - 1."""
    for n in range(first, last):
        block = grid.active[n] * BLOCK
        if ti.static(step.threads > 1):
            velocity_to_momentum(grid, node_of(grid.active[n], step.thread))
        else:
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    velocity_to_momentum(grid, block + ti.Vector([a, b, c]))


@ti.func
def velocity_to_momentum(grid: ti.template(), I):
    """Turn the velocity of a node to a momentum."""
    q = grid.nodes[I]
    grid.nodes[I] = ti.Vector([q[3] * q[0], q[3] * q[1], q[3] * q[2], q[3]])

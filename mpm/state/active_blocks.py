"""The list of blocks of nodes that hold material.
A block is active in a substep when it carries the number of that substep as its stamp."""

from mpm.backend import ti
from mpm.scene.grid import BLOCK
from mpm.state.nodes import first_nodes
from mpm.state.packs import LANES


def wrap_stamp(stamp: int) -> int:
    """Return the number of a substep as the kernels' 32-bit integers hold it; stamps are only compared."""
    return (stamp + 2**31) % 2**32 - 2**31


@ti.func
def mark_pack(grid: ti.template(), x: ti.template(), q, inverse_cell, last: ti.i32, stamp: ti.i32, left_out: ti.i32):
    """Activate the blocks that the stencils of a pack reach; return the last key.
    last: the key of the previous lane. left_out: bits of lanes that activate nothing."""
    nodes = first_nodes(grid, x, q, inverse_cell)[0]
    key = last
    for lane in ti.static(range(LANES)):
        if (left_out >> lane) & 1 == 0:
            key = mark(grid, ti.Vector([nodes[d][lane] for d in range(3)]), key, stamp)
    return key


@ti.func
def mark(grid: ti.template(), node, last: ti.i32, stamp: ti.i32):
    """Activate the blocks of the stencil that begins at a node, unless its key is `last`; return the key."""
    b = node // BLOCK
    # one bit for each way in which a stencil can reach over the upper faces of the block
    reach = (node + 2) // BLOCK - b
    way = reach[0] * 4 + reach[1] * 2 + reach[2]
    key = ((b[0] * grid.stamp.shape[1] + b[1]) * grid.stamp.shape[2] + b[2]) * 8 + way
    if ti.static(not grid.lists):
        if key != last:
            activate_all(grid, b, reach, stamp)
    elif key != last:  # neighbours in memory are mostly neighbours in space
        if grid.seed[b][0] != stamp:
            grid.seed[b] = ti.Vector([stamp, 0])
        ways = grid.seed[b][1]
        if (ways & (1 << way)) == 0:
            grid.seed[b] = ti.Vector([stamp, ways | (1 << way)])
            activate_all(grid, b, reach, stamp)
    return key


@ti.func
def activate_all(grid: ti.template(), b, reach, stamp: ti.i32):
    """Activate the blocks of a stencil that begins in block b and reaches over the upper faces in `reach`."""
    for i in range(b[0], b[0] + reach[0] + 1):
        for j in range(b[1], b[1] + reach[1] + 1):
            for k in range(b[2], b[2] + reach[2] + 1):
                activate(grid, ti.Vector([i, j, k]), stamp)


@ti.func
def mark_place(grid: ti.template(), x, inverse_cell, stamp: ti.i32):
    """Activate the blocks of one particle's stencil; x (3,) [m] relative to node (0, 0, 0)."""
    node = ti.Vector([ti.cast(ti.floor(x[d] * inverse_cell - 0.5), ti.i32) for d in range(3)])
    last = ti.Vector([grid.width - 3, grid.nodes.shape[1] - 3, grid.nodes.shape[2] - 3])
    mark(grid, ti.max(ti.min(node, last), 0), -1, stamp)


@ti.func
def note_reached(grid: ti.template(), part, node: ti.template(), last: ti.i32, stamp: ti.i32, layers: ti.template()):
    """Note that a part of the packs scatters to the blocks of a stencil, see `mark`; return the key."""
    b = ti.Vector([node[d] // BLOCK for d in range(3)])
    reach = ti.Vector([(node[d] + 2) // BLOCK - node[d] // BLOCK for d in range(3)])
    key = ((b[0] * grid.stamp.shape[1] + b[1]) * grid.stamp.shape[2] + b[2]) * 8 \
        + reach[0] * 4 + reach[1] * 2 + reach[2]
    if key != last:
        for i in range(b[0], b[0] + reach[0] + 1):
            for j in range(b[1], b[1] + reach[1] + 1):
                for k in range(b[2], b[2] + reach[2] + 1):
                    for layer in ti.static(range(layers)):
                        grid.reached[part, i + layer * ti.static(grid.width // BLOCK), j, k] = stamp
    return key


@ti.func
def activate(grid: ti.template(), block, stamp: ti.i32):
    """Stamp a block for this substep, and list it, once; several threads, which write the same number, list later."""
    if grid.stamp[block] != stamp:
        grid.stamp[block] = stamp
        if ti.static(grid.lists):
            grid.active[grid.count[None]] = block
            grid.count[None] = grid.count[None] + 1
        else:
            grid.rows[block[0], block[1]] = stamp


@ti.func
def activate_and_list(grid: ti.template(), block, stamp: ti.i32):
    """Activate a block, and list it now also where several threads would list it later: in a phase of one thread."""
    if grid.stamp[block] != stamp:
        activate(grid, block, stamp)
        if ti.static(not grid.lists):
            grid.seed[block][0] = stamp
            grid.active[grid.count[None]] = block
            grid.count[None] = grid.count[None] + 1


@ti.func
def mark_all(grid: ti.template(), particles: ti.template(), inverse_cell, stamp: ti.i32):
    """List the blocks that the stencils of all particles reach."""
    grid.count[None] = 0
    last = -1
    for q in range(particles.pack_count[None]):
        last = mark_pack(grid, particles.x, q, inverse_cell, last, stamp, 0)


@ti.func
def list_row(grid: ti.template(), row, stamp):
    """List blocks of a row of the grid that carry a stamp, each once: in order on a CPU, in any order on a GPU."""
    i, j = row // grid.stamp.shape[1], row % grid.stamp.shape[1]
    if grid.rows[i, j] == stamp:
        for k in range(grid.stamp.shape[2]):
            if grid.stamp[i, j, k] == stamp and grid.seed[i, j, k][0] != stamp:
                grid.seed[i, j, k][0] = stamp
                grid.active[ti.atomic_add(grid.count[None], 1)] = ti.Vector([i, j, k])


class SubstepCounter:
    """Hands out numbers that no substep has had."""

    def __init__(self) -> None:
        self.last = 0  # number of the last substep
        self.is_listed = False  # whether the blocks of the next substep are on the grid's list

    @property
    def next(self) -> int:
        """Number of the next substep."""
        return self.last + 1

    def pass_substeps(self, count: int) -> None:
        """Count substeps whose blocks were listed as they ran."""
        self.last = wrap_stamp(self.last + count)

    def take(self, count: int) -> int:
        """Return the first of `count` numbers that no substep has had; what is on the grid's list is void."""
        self.is_listed = False
        first = wrap_stamp(self.last + 2)  # blocks that the last advance listed carry the one after its own
        self.last = wrap_stamp(first + count - 1)
        return first

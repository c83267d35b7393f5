"""The background grid: its extent, its node fields, and the blocks that hold material."""

from dataclasses import dataclass

import numpy as np

from mpm.backend import real_type, ti
from mpm.errors import InvalidValue
from mpm.materials.hencky_strain import keep

GHOST = 2
"""Nodes outside each wall: one is reached by the quadratic spline, one more keeps every stencil inside the array."""
BLOCK = 4
"""Nodes along the edge of a block of the active list."""


@dataclass(frozen=True)
class Grid:
    """A box of nodes. Its faces are the walls, on the first and last plane of nodes."""

    lower: tuple[float, float, float]
    """[m]"""
    upper: tuple[float, float, float]
    """[m]; moved up to the next node."""
    cell: float
    """dx [m]"""

    def __post_init__(self) -> None:
        if not 0 < self.cell < np.inf:
            raise InvalidValue(f"Grid: cell = {self.cell} m; accepted: a positive length")
        span = np.subtract(self.upper, self.lower)
        if span.shape != (3,) or not np.isfinite(span).all() or np.any(span < (1 - 1e-9) * self.cell):
            raise InvalidValue(f"Grid: {self.lower} .. {self.upper} m is no box of a cell of {self.cell} m or more")

    @property
    def cells(self) -> np.ndarray:
        """Cells along each axis (3,)."""
        return np.ceil(np.subtract(self.upper, self.lower) / self.cell - 1e-9).astype(int)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along each axis, ghosts included, filled up to whole blocks."""
        nodes = self.cells + 1 + 2 * GHOST
        nx, ny, nz = (int(n) for n in -(-nodes // BLOCK) * BLOCK)
        return nx, ny, nz

    @property
    def origin(self) -> np.ndarray:
        """Position [m] (3,) of node (0, 0, 0)."""
        return np.asarray(self.lower, float) - GHOST * self.cell

    def check_inside(self, positions: np.ndarray) -> None:
        """Raise InvalidValue when a position [m] (n, 3) lies outside the walls."""
        upper = np.asarray(self.lower) + self.cells * self.cell
        outside = np.flatnonzero(np.any((positions < self.lower) | (positions > upper), axis=1))
        if len(outside):
            raise InvalidValue(
                f"{len(outside)} particles lie outside the grid {self.lower} .. {tuple(upper)} m, "
                f"first: particle {outside[0]} at {tuple(positions[outside[0]])}"
            )


class GridFields:
    """Node values and the list of active blocks.

    With `layers` = 2 every node exists twice, the second time `width` places farther along x: material that a thin
    shell cuts off from a node meets the shell there, in a field of its own (see `sides`).
    """

    def __init__(self, grid: Grid, precision: str, layers: int = 1, lists: bool = True) -> None:
        real = real_type(precision)
        nx, ny, nz = grid.shape
        self.layers, self.width, self.cell = layers, nx, grid.cell
        self.lists = lists
        """Whether marking a block lists it, too: one thread can, several leave that to `Phases`."""
        self.cells = tuple(int(n) for n in grid.cells)
        self.nodes = ti.Vector.field(4, real, (layers * nx, ny, nz))
        """(momentum, mass) after the scatter, (velocity, mass) after the grid update."""
        blocks = (layers * nx // BLOCK, ny // BLOCK, nz // BLOCK)
        self.stamp = ti.field(ti.i32, blocks)
        """Number of the substep in which the block was last active."""
        self.seed = ti.Vector.field(2, ti.i32, blocks)
        """Substep in which a stencil last started in the block, and the ways in which stencils reach over its faces."""
        self.active = ti.Vector.field(3, ti.i32, int(np.prod(blocks)))
        """Indices of the active blocks."""
        self.count = ti.field(ti.i32, ())
        """Number of active blocks."""

    def nodes_near(self, radius: float) -> int:
        """Nodes, layers counted, that a ball of this radius [m] can hold."""
        across = 2.0 * radius / self.cell + 2.0
        return int(min(self.layers * int(across**3), np.prod(self.nodes.shape)))


def wrapped(stamp: int) -> int:
    """The number of a substep as the kernels' integers hold it; stamps are only ever compared with each other."""
    return (stamp + 2**31) % 2**32 - 2**31


@ti.func
def in_first_layer(grid: ti.template(), I):
    """The node (3,) without the layer that it belongs to."""
    J = I
    if ti.static(grid.layers == 2):
        J[0] = I[0] % grid.width
    return J


@ti.func
def first_nodes(grid: ti.template(), x: ti.template(), q, inverse_cell):
    """First nodes of the stencils of pack q, three integer packs, and the offsets from them in cells, in [0.5, 1.5).

    Nodes are kept inside the array even when a position is not finite.
    """
    return stencil(grid, [keep(x[d][q] * inverse_cell) for d in range(3)])


@ti.func
def stencil(grid: ti.template(), scaled: ti.template()):
    """First nodes and offsets at three coordinates in cells, packs or single numbers."""
    floors = [keep(ti.floor(scaled[d] - 0.5)) for d in range(3)]
    last = ti.static((grid.width - 3, grid.nodes.shape[1] - 3, grid.nodes.shape[2] - 3))
    nodes = [keep(ti.max(ti.min(ti.cast(floors[d], ti.i32), last[d]), 0)) for d in range(3)]
    return nodes, [keep(scaled[d] - floors[d]) for d in range(3)]


@ti.func
def mark_pack(grid: ti.template(), x: ti.template(), q, inverse_cell, last: ti.i32, stamp: ti.i32):
    """Activate the blocks that the stencils of a pack reach; `last` is the key of the lane before; returns the key."""
    nodes = first_nodes(grid, x, q, inverse_cell)[0]
    key = last
    for lane in ti.static(range(4)):
        key = mark(grid, ti.Vector([nodes[d][lane] for d in range(3)]), key, stamp)
    return key


@ti.func
def mark(grid: ti.template(), node, last: ti.i32, stamp: ti.i32):
    """Activate the blocks of the stencil that begins at a node, unless its key is `last`; returns the key."""
    b = node // BLOCK
    # one bit for each way in which a stencil can reach over the upper faces of the block
    reach = (node + 2) // BLOCK - b
    way = reach[0] * 4 + reach[1] * 2 + reach[2]
    key = ((b[0] * grid.stamp.shape[1] + b[1]) * grid.stamp.shape[2] + b[2]) * 8 + way
    if ti.static(not grid.lists):
        if key != last:
            stamp_blocks(grid, b, reach, stamp)
    elif key != last:  # neighbours in memory are mostly neighbours in space
        if grid.seed[b][0] != stamp:
            grid.seed[b] = ti.Vector([stamp, 0])
        ways = grid.seed[b][1]
        if (ways & (1 << way)) == 0:
            grid.seed[b] = ti.Vector([stamp, ways | (1 << way)])
            for i in range(b[0], b[0] + reach[0] + 1):
                for j in range(b[1], b[1] + reach[1] + 1):
                    for k in range(b[2], b[2] + reach[2] + 1):
                        activate(grid, ti.Vector([i, j, k]), stamp)
    return key


@ti.func
def stamp_blocks(grid: ti.template(), b, reach, stamp: ti.i32):
    """Stamp the blocks of a stencil, whoever else does: all write the same number."""
    for i in range(b[0], b[0] + reach[0] + 1):
        for j in range(b[1], b[1] + reach[1] + 1):
            for k in range(b[2], b[2] + reach[2] + 1):
                grid.stamp[i, j, k] = stamp


@ti.func
def mark_place(grid: ti.template(), x, inverse_cell, stamp: ti.i32):
    """Activate the blocks of one grain's stencil; x (3,) as the particles keep it."""
    node = ti.Vector([ti.cast(ti.floor(x[d] * inverse_cell - 0.5), ti.i32) for d in range(3)])
    last = ti.Vector([grid.width - 3, grid.nodes.shape[1] - 3, grid.nodes.shape[2] - 3])
    mark(grid, ti.max(ti.min(node, last), 0), -1, stamp)


@ti.func
def activate(grid: ti.template(), block, stamp: ti.i32):
    """Put a block on the list of this substep, once."""
    if grid.stamp[block] != stamp:
        grid.stamp[block] = stamp
        grid.active[grid.count[None]] = block
        grid.count[None] = grid.count[None] + 1


@ti.func
def clear(grid: ti.template(), first, last):
    """Zero the nodes of the active blocks first .. last - 1."""
    for n in range(first, last):
        corner = grid.active[n] * BLOCK
        for a in range(BLOCK):
            for c in range(BLOCK):
                for d in ti.static(range(BLOCK)):
                    grid.nodes[corner + ti.Vector([a, c, d])] = ti.Vector.zero(grid.nodes.dtype, 4)

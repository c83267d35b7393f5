"""The background grid: its extent, its node fields, and the blocks that hold material."""

from dataclasses import dataclass

import numpy as np

from mpm.backend import real_type, ti
from mpm.errors import InvalidValue
from mpm.strain import keep

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
        if self.cell <= 0:
            raise InvalidValue(f"Grid: cell = {self.cell} m; accepted: a positive length")
        span = np.subtract(self.upper, self.lower)
        if span.shape != (3,) or np.any(span < 3 * self.cell):
            raise InvalidValue(f"Grid: {self.lower} .. {self.upper} m is not a box of 3 cells of {self.cell} m or more")

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


@ti.func
def clamped(first: ti.template(), l: ti.template(), nodes: ti.template()):
    """Integer index of a lane's first node, kept inside the array even when a position is not finite."""
    return [keep(ti.math.clamp(ti.cast(first[d][l], ti.i32), 0, nodes.shape[d] - 3)) for d in range(3)]


class GridFields:
    """Node values and the list of active blocks."""

    def __init__(self, grid: Grid, precision: str) -> None:
        real = real_type(precision)
        self.nodes = ti.Vector.field(4, real, grid.shape)
        """(momentum, mass) after the scatter, (velocity, mass) after the grid update."""
        blocks = tuple(n // BLOCK for n in grid.shape)
        self.stamp = ti.field(ti.i32, blocks)
        """Number of the substep in which the block was last active."""
        self.seed = ti.Vector.field(2, ti.i32, blocks)
        """Substep in which a stencil last started in the block, and the ways in which stencils reach over its faces."""
        self.active = ti.Vector.field(3, ti.i32, int(np.prod(blocks)))
        """Indices of the active blocks."""
        self.count = ti.field(ti.i32, ())
        """Number of active blocks."""


@ti.func
def mark_packs(grid: ti.template(), x: ti.template(), packs, inverse_cell, stamp: ti.i32):
    """Activate the blocks that the stencils of all particles reach; positions x are three pack fields."""
    last = -1
    for q in range(packs):
        first = [keep(ti.floor(x[d][q] * inverse_cell - 0.5)) for d in range(3)]
        for lane in ti.static(range(4)):
            node = clamped(first, lane, grid.nodes)
            b = [keep(node[d] // BLOCK) for d in range(3)]
            # one bit for each way in which a stencil can reach over the upper faces of the block
            reach = [keep((node[d] + 2) // BLOCK - b[d]) for d in range(3)]
            way = reach[0] * 4 + reach[1] * 2 + reach[2]
            key = ((b[0] * grid.stamp.shape[1] + b[1]) * grid.stamp.shape[2] + b[2]) * 8 + way
            if key != last:  # neighbours in memory are mostly neighbours in space
                last = key
                if grid.seed[b[0], b[1], b[2]][0] != stamp:
                    grid.seed[b[0], b[1], b[2]] = ti.Vector([stamp, 0])
                ways = grid.seed[b[0], b[1], b[2]][1]
                if (ways & (1 << way)) == 0:
                    grid.seed[b[0], b[1], b[2]] = ti.Vector([stamp, ways | (1 << way)])
                    spread_block(grid, b, reach, stamp)


@ti.func
def spread_block(grid: ti.template(), b: ti.template(), reach: ti.template(), stamp: ti.i32):
    """Activate and clear a block and the upper neighbours that are reached."""
    for i in range(b[0], b[0] + reach[0] + 1):
        for j in range(b[1], b[1] + reach[1] + 1):
            for k in range(b[2], b[2] + reach[2] + 1):
                if grid.stamp[i, j, k] != stamp:
                    grid.stamp[i, j, k] = stamp
                    grid.active[grid.count[None]] = ti.Vector([i, j, k])
                    grid.count[None] = grid.count[None] + 1
                    for a in range(BLOCK):
                        for c in range(BLOCK):
                            for d in ti.static(range(BLOCK)):
                                node = ti.Vector([BLOCK * i + a, BLOCK * j + c, BLOCK * k + d])
                                grid.nodes[node] = ti.Vector.zero(grid.nodes.dtype, 4)

"""The six walls, second order: ghost nodes are folded onto their mirror nodes, and unfolded after the grid update.

A wall lies on a plane of nodes. The mirrored half space closes the stencils of the grains beside it, so that the
wall acts where it is; zeroing nodes would displace it by about 0.18 cells and make the whole scheme first order.
A column (mirror node, wall node, ghost node) that pulls away from a separable wall is left unfolded.
"""

from dataclasses import dataclass

import numpy as np

from mpm.backend import ti
from mpm.errors import InvalidValue, UnknownName
from mpm.grid import BLOCK, GHOST, Grid

FRICTION, SLIP, ROLLER, STICK = range(4)
CONDITIONS = {"friction": FRICTION, "slip": SLIP, "roller": ROLLER, "stick": STICK}
Sides = tuple[str, str, str]
WALL_ROW = 1
"""Row of the ledger that the walls' impulses go to."""


@dataclass(frozen=True, kw_only=True)
class Walls:
    """Condition per side. friction: may leave the wall, Coulomb friction; slip: may leave, no friction; roller: normal
    velocity zero for good, no friction; stick: velocity zero.
    """

    friction: float = 0.5
    """Coulomb coefficient of the "friction" sides."""
    lower: Sides = ("friction", "friction", "friction")
    """Conditions at the lower x, y and z walls."""
    upper: Sides = ("friction", "friction", "friction")
    """Conditions at the upper x, y and z walls."""

    def __post_init__(self) -> None:
        for condition in (*self.lower, *self.upper):
            if condition not in CONDITIONS:
                raise UnknownName("wall condition", condition, CONDITIONS)
        if self.friction < 0:
            raise InvalidValue(f"Walls: friction = {self.friction}; accepted: 0 or more")


def wall_table(walls: Walls, grid: Grid) -> np.ndarray:
    """The six walls (6, 4) in the order in which they are folded: axis, plane of nodes, inward sign, condition."""
    rows = []
    for axis in range(3):
        rows.append((axis, GHOST, 1, CONDITIONS[walls.lower[axis]]))
        rows.append((axis, GHOST + int(grid.cells[axis]), -1, CONDITIONS[walls.upper[axis]]))
    return np.array(rows, np.int32)


@ti.func
def mirrored(q, n, condition):
    """Momentum (or velocity), a 4-vector, as its mirror image in the wall with normal n carries it."""
    image = q - 2.0 * q.dot(n) * n
    if condition == STICK:
        image = -q
    return image


@ti.func
def folded_earlier(table: ti.template(), I, axis):
    """Whether the node is a ghost of a wall folded before this axis: its momentum has moved on already."""
    hidden = False
    for other in range(6):
        if table[other, 0] < axis:
            place = I[0] * (table[other, 0] == 0) + I[1] * (table[other, 0] == 1)
            if (place - table[other, 1]) * table[other, 2] < 0:
                hidden = True
    return hidden


@ti.func
def unit(axis):
    """Unit vector (3,) of an axis, as integers."""
    return ti.Vector([ti.cast(axis == 0, ti.i32), ti.cast(axis == 1, ti.i32), ti.cast(axis == 2, ti.i32)])


@ti.func
def column(block, a, b, axis, node):
    """Wall node (3,) of the column through place (a, b) of a block's face."""
    e = unit(axis)
    first = unit((axis + 1) % 3)
    second = unit((axis + 2) % 3)
    return block * BLOCK * (1 - e) + node * e + a * first + b * second


@ti.func
def ghost_mass(grid: ti.template(), ghost, stamp):
    """Mass of a ghost node; zero when its block is not active, negative once folded."""
    mass = ti.cast(0, grid.nodes.dtype)
    if grid.stamp[ghost // BLOCK] == stamp:
        mass = grid.nodes[ghost][3]
    return mass


@ti.func
def normal4(axis, inward, real: ti.template()):
    """Inward normal with a fourth entry for the mass."""
    e = unit(axis) * inward
    return ti.Vector([ti.cast(e[0], real), ti.cast(e[1], real), ti.cast(e[2], real), ti.cast(0, real)])


@ti.func
def fold(grid: ti.template(), table: ti.template(), stamp, dt, gravity):
    """Add ghost momentum and mass to the mirror nodes; a folded ghost keeps its raw values, its mass negated."""
    for w in range(6):
        axis, node, inward, condition = table[w, 0], table[w, 1], table[w, 2], table[w, 3]
        n = normal4(axis, inward, grid.nodes.dtype)
        fall = dt * (gravity[0] * n[0] + gravity[1] * n[1] + gravity[2] * n[2])
        for active in range(grid.count[None]):
            block = grid.active[active]
            if block.dot(unit(axis)) == node // BLOCK:
                for a, b in ti.ndrange(BLOCK, BLOCK):
                    W = column(block, a, b, axis, node)
                    ghost = W - unit(axis) * inward
                    m_g = ghost_mass(grid, ghost, stamp)
                    if m_g > 0 and not folded_earlier(table, W, axis):
                        mirror = W + unit(axis) * inward
                        raw = grid.nodes[ghost]
                        image = mirrored(raw, n, condition)
                        image[3] = m_g
                        sum = grid.nodes[mirror] + image
                        # the impulse that would hold the column; a pull means that it is leaving
                        at_wall = grid.nodes[W]
                        pushed = -(at_wall.dot(n) + at_wall[3] * fall) \
                            - 2.0 * (m_g * (sum.dot(n) / sum[3] + fall) + raw.dot(n))
                        if condition == ROLLER or condition == STICK or pushed > 0:
                            grid.nodes[mirror] = sum
                            raw[3] = -m_g
                            grid.nodes[ghost] = raw


@ti.func
def unfold(grid: ti.template(), table: ti.template(), stamp, friction, origin, cell, out: ti.template()):
    """Give ghosts the mirrored velocity, hold the wall's nodes, credit the impulses to the ledger's wall row."""
    for back in range(6):
        w = 5 - back
        axis, node, inward, condition = table[w, 0], table[w, 1], table[w, 2], table[w, 3]
        n = normal4(axis, inward, grid.nodes.dtype)
        for active in range(grid.count[None]):
            block = grid.active[active]
            if block.dot(unit(axis)) == node // BLOCK:
                for a, b in ti.ndrange(BLOCK, BLOCK):
                    W = column(block, a, b, axis, node)
                    ghost = W - unit(axis) * inward
                    if folded_earlier(table, W, axis):
                        # ghosts of an earlier wall that are leaving it may not enter this one either
                        stop_node(grid, W, n, SLIP, False, friction * 0.0, friction, origin, cell, out)
                        if ghost_mass(grid, ghost, stamp) > 0:
                            stop_node(grid, ghost, n, SLIP, False, friction * 0.0, friction, origin, cell, out)
                    else:
                        mirror = W + unit(axis) * inward
                        m_g = ghost_mass(grid, ghost, stamp)
                        pair = ti.cast(0, grid.nodes.dtype)
                        if m_g < 0:
                            raw = grid.nodes[ghost]
                            u = grid.nodes[mirror]
                            image = mirrored(u, n, condition)
                            given = -m_g * image - raw
                            taken = mirrored(given, n, condition)
                            pair = (given - taken).dot(n)
                            credit(out, WALL_ROW, position(ghost, origin, cell), given)
                            credit(out, WALL_ROW, position(mirror, origin, cell), -taken)
                            image[3] = -m_g
                            grid.nodes[ghost] = image
                            u[3] += m_g  # back to its own mass, which later credits count
                            grid.nodes[mirror] = u
                        elif m_g > 0:  # an unfolded ghost may leave, not enter
                            stop_node(grid, ghost, n, SLIP, False, pair, friction, origin, cell, out)
                        stop_node(grid, W, n, condition, m_g < 0, pair, friction, origin, cell, out)


@ti.func
def stop_node(grid: ti.template(), I, n, condition, held, pair, friction, origin, cell, out: ti.template()):
    """Apply the wall's condition to a node; `pair` is the normal impulse of the folded pair, which adds to friction."""
    q = grid.nodes[I]
    if q[3] > 0:
        mass = q[3]
        q[3] = 0.0
        into = q.dot(n)
        v = q
        if condition == STICK:
            v = q * 0.0
        elif condition == ROLLER or held or into < 0:
            v = q - into * n
        if condition == FRICTION:
            slide = q - into * n
            push = ti.max(mass * (v.dot(n) - into) + pair, 0.0)
            left = ti.max(1.0 - friction * push / (mass * slide.norm(1e-15)), 0.0)
            v = v.dot(n) * n + left * slide
        credit(out, WALL_ROW, position(I, origin, cell), mass * (v - q))
        v[3] = mass
        grid.nodes[I] = v


@ti.func
def position(I, origin, cell):
    """Position of a node [m]."""
    return ti.cast(I, ti.f64) * cell + origin


@ti.func
def credit(out: ti.template(), row: ti.template(), place, impulse):
    """Add an impulse at a place to a ledger row: (linear, angular about the world's origin)."""
    p = ti.Vector([ti.cast(impulse[d], ti.f64) for d in range(3)])
    moment = place.cross(p)
    for d in ti.static(range(3)):
        out[row, d] = out[row, d] + p[d]
        out[row, 3 + d] = out[row, 3 + d] + moment[d]

"""Who gave the grains which impulse: rows of (linear, angular about the world's origin), summed in double precision."""

from mpm.backend import is_concurrent, ti

GRAVITY_ROW, WALL_ROW, FIRST_COLLIDER_ROW = range(3)
"""Ledger rows: gravity with body accelerations, walls, then the colliders; momentum and status follow them."""


@ti.func
def position(I, origin, cell):
    """Position of a node [m]."""
    return ti.cast(I, ti.f64) * cell + origin


@ti.func
def add(out: ti.template(), row: ti.template(), column: ti.template(), value):
    """Add to an entry of the ledger: a plain load and store where one thread does."""
    if ti.static(is_concurrent()):
        ti.atomic_add(out[row, column], value)
    else:
        out[row, column] = out[row, column] + value


@ti.func
def lift(out: ti.template(), row: ti.template(), column: ti.template(), value):
    """Keep the larger of an entry and a value."""
    if ti.static(is_concurrent()):
        ti.atomic_max(out[row, column], value)
    else:
        out[row, column] = ti.max(out[row, column], value)


@ti.func
def credit(out: ti.template(), row: ti.template(), place, impulse):
    """Add an impulse at a place to a ledger row."""
    p = ti.Vector([ti.cast(impulse[d], ti.f64) for d in range(3)])
    moment = place.cross(p)
    for d in ti.static(range(3)):
        add(out, row, d, p[d])
        add(out, row, 3 + d, moment[d])

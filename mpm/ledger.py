"""Who gave the grains which impulse: rows of (linear, angular about the world's origin), summed in double precision."""

from mpm.backend import ti

GRAVITY_ROW, WALL_ROW, FIRST_COLLIDER_ROW = range(3)
"""Ledger rows: gravity with body accelerations, walls, then the colliders; momentum and status follow them."""


@ti.func
def position(I, origin, cell):
    """Position of a node [m]."""
    return ti.cast(I, ti.f64) * cell + origin


@ti.func
def credit(out: ti.template(), row: ti.template(), place, impulse):
    """Add an impulse at a place to a ledger row."""
    p = ti.Vector([ti.cast(impulse[d], ti.f64) for d in range(3)])
    moment = place.cross(p)
    for d in ti.static(range(3)):
        out[row, d] = out[row, d] + p[d]
        out[row, 3 + d] = out[row, 3 + d] + moment[d]

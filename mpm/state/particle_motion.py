"""Motion of the particles: displacements, compensated in single precision, walls, and the blocks that they reach."""

from mpm.backend import ti
from mpm.state.active_blocks import mark_pack
from mpm.state.packs import pack_at

NEAREST = 0.499
"""Quanta by which a displacement is moved away from zero before it is truncated, so that it is rounded to the nearest.
With a half, a remainder of just that would move a particle at rest to and fro."""


@ti.func
def drift_packs(fields: ti.template(), P: ti.template(), dt, stamp: ti.i32, first, last):
    """Move packs first .. last - 1 for half of a stride, dt [s], and activate the blocks that their stencils reach."""
    last_key = -1
    for place in range(first, last):
        q = pack_at(fields, place)
        time = drift_before(fields, P, q, dt)
        for r in ti.static(range(3)):
            move_pack(fields, P, q, r, time * P.v[r][q])
        last_key = mark_active_lanes(fields, P, q, last_key, stamp)


@ti.func
def drift_before(fields: ti.template(), P: ti.template(), q, dt):
    """Return the time [s] that each lane of pack q drifts before a stride of 2 dt [s]: dt, or 0 for one that would
    reach a wall in the stride, since the wall has not acted on it yet."""
    time = dt + 0.0 * P.v[0][q]
    for r in ti.static(range(3)):
        if ti.static(not fields.features.periodic[r]):
            x = P.x[r][q] + 2.0 * dt * P.v[r][q]
            time = ti.select(keep_inside(fields, x, r) == x, time, 0.0 * time)
    return time


@ti.func
def move_pack(fields: ti.template(), P: ti.template(), q, axis: ti.template(), displacement):
    """Move pack q by `displacement` [m] along an axis."""
    if ti.static(len(P.remainder) > 0):
        x, remainder = displaced(fields, P.x[axis][q], P.remainder[axis][q], displacement, axis)
        P.x[axis][q] = x
        P.remainder[axis][q] = remainder
    else:
        P.x[axis][q] = keep_inside(fields, P.x[axis][q] + displacement, axis)


@ti.func
def move_lane(fields: ti.template(), P: ti.template(), q, l, displacement):
    """Move one lane of pack q by `displacement` [m] (3,); return its coordinates [m]. Other lanes are not touched."""
    x = ti.Vector([P.x[d][q][l] for d in range(3)])
    for d in ti.static(range(3)):
        if ti.static(len(P.remainder) > 0):
            coordinate, remainder = displaced(fields, x[d], P.remainder[d][q][l], displacement[d], d)
            x[d] = coordinate
            P.remainder[d][q][l] = remainder
        else:
            x[d] = keep_inside(fields, x[d] + displacement[d], d)
        P.x[d][q][l] = x[d]
    return x


@ti.func
def displaced(fields: ti.template(), x, remainder, displacement, axis: ti.template()):
    """Return the coordinate [m] after a displacement [m], and the new remainder [m]; for packs and single numbers.
    A compensated sum (Kahan 1965, Comm. ACM 8, 40): coordinates move by whole quanta, which is exact, and the rest of a
    displacement is kept. Kahan's own difference (x + displacement) - x is `displacement` to a compiler with
    fast-math."""
    quantum = ti.static(fields.quantum[axis])
    total = remainder + displacement
    count = total * ti.static(1.0 / quantum)
    # to the nearest: remainders with a mean in the direction of motion would be a torque on what turns
    whole = ti.cast(ti.cast(count + ti.max(ti.min(count, NEAREST), -NEAREST), ti.i32), fields.real)
    moved = whole * quantum
    return keep_inside(fields, x + moved, axis), total - moved


@ti.func
def mark_active_lanes(fields: ti.template(), P: ti.template(), q, last_key, stamp: ti.i32):
    """Activate the blocks that the stencils of pack q reach, without those of lanes that sleep; return the last key."""
    asleep = 0
    if ti.static(fields.features.sleep):
        asleep = fields.sleepers.lanes_asleep[q]
    return mark_pack(fields.grid, P.x, q, 1.0 / fields.cell, last_key, stamp, asleep)


@ti.func
def drift_after(fields: ti.template(), step: ti.template()):
    """Return the time [s] that particles drift after a substep: half of the stride that ends with it, 0 within one.
    Where there are no strides, the whole substep."""
    share = ti.static(0.5 if fields.features.strides else 1.0)
    return share * step.dt * step.span


@ti.func
def keep_inside(fields: ti.template(), x, axis: ti.template()):
    """Return a coordinate [m], or a pack of them, after a move: wrapped on a periodic axis, held by walls on others."""
    low = fields.corner
    high = fields.corner + fields.span[axis]
    result = x
    if ti.static(fields.features.periodic[axis]):
        result = ti.select(x < low, x + fields.span[axis], ti.select(x >= high, x - fields.span[axis], x))
    else:  # holds a particle that an inaccurate step would carry through a wall
        result = ti.max(ti.min(x, high), low)
    return result

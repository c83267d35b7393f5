"""Grid to particle: velocity and affine velocity, the particles' move, and the active blocks of the next substep."""

from mpm.backend import is_concurrent, is_shared, once, ti
from mpm.state.active_blocks import list_row, mark_pack
from mpm.state.ledger import add
from mpm.state.nodes import first_nodes
from mpm.state.packs import LANES
from mpm.state.particles import SPEED_LIMIT
from mpm.state.sleepers import is_awake, pack_at
from mpm.transfers.particle_grid import NodeValues, SingleLayer, gather, lane_weights, moments, weights

NEAREST = 0.499
"""Quanta by which a displacement is moved away from zero before it is truncated, so that it is rounded to the nearest.
With a half, a remainder of just that would move a particle at rest to and fro."""


@ti.func
def start_block_list(fields: ti.template(), step: ti.template(), first, last):
    """Phase: empty the list of active blocks before particles that move list those of the next substep."""
    if step.span > 0:
        fields.grid.count[None] = 0
    fields.particles.fastest[None] = 0.0
    fields.particles.squares[None] = 0.0


@ti.func
def gather_packs(fields: ti.template(), step: ti.template(), first, last):
    """Phase: gather velocities of packs first .. last - 1; at the end of a stride, move the particles."""
    gather_and_move(fields, fields.particles, drift_after(step.dt, step.span), step.stamp + step.span, first, last)
    if ti.static(not fields.features.sleep):  # there, padding lanes always sleep
        for body in range(fields.parameters.densities.shape[0]):
            ends = fields.particles.range_table[body]
            if first < ends[1] and ends[1] <= last:
                zero_padding_lanes(fields.particles, ends[1] - 1, ends[2])


@ti.func
def gather_and_move(fields: ti.template(), P: ti.template(), dt, next_stamp: ti.i32, first, last):
    """Gather velocity and affine velocity of packs first .. last - 1; where dt > 0, move them for that time [s].

    The blocks that moved particles reach are activated for the next substep.
    """
    last_key = -1
    fastest = ti.Vector.zero(fields.real, LANES)
    squares = fastest
    for place in range(first, last):
        q = pack_at(fields, place)
        v, B, f = gather_pack(fields, P, q)
        gradient = 4.0 / fields.cell
        for r in ti.static(range(3)):
            P.v[r][q] = v[r]
            for c in ti.static(range(3)):
                P.C[3 * r + c][q] = gradient * (B[3 * r + c] - v[r] * f[c])
        if dt > 0:
            for r in ti.static(range(3)):
                displacement = dt * v[r]
                if ti.static(len(P.remainder) > 0 and len(fields.features.shells) > 0):
                    # `move_listed` moves the others, from where they are now
                    displacement = ti.select(P.side[q] == 0.0, displacement, 0.0 * displacement)
                move_pack(fields, P, q, r, displacement)
            last_key = mark_awake(fields, P, q, last_key, next_stamp)
        v2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        fastest = ti.max(fastest, v2)
        squares += v2
    note_speeds(P, fastest.max(), squares.sum())


@ti.func
def note_speeds(P: ti.template(), fastest, squares):
    """Note the largest squared speed and the sum of squared speeds of some particles."""
    if ti.static(is_concurrent()):
        ti.atomic_max(P.fastest[None], fastest)
        ti.atomic_add(P.squares[None], squares)
    else:
        P.fastest[None] = ti.max(P.fastest[None], fastest)
        P.squares[None] = P.squares[None] + squares


@ti.func
def check_speeds(fields: ti.template(), step: ti.template(), first, last):
    """Phase: halt the launch where a particle is not finite, or would travel more than SPEED_LIMIT cells a substep."""
    limit = ti.static(SPEED_LIMIT * fields.cell)
    fastest, squares = fields.particles.fastest[None], fields.particles.squares[None]
    is_sound = fastest * step.dt * step.dt <= limit * limit and squares - squares == 0.0
    if not is_sound and fields.particles.halted[None] == 0:
        fields.particles.halted[None] = step.row + 1
        if ti.static(is_shared()):  # there, the host learns it at the end of the launch
            add(step.out, fields.rows.status, 2, ti.cast(step.row + 1, ti.f64))


@ti.func
def gather_pack(fields: ti.template(), P: ti.template(), q):
    """Return velocity (three packs) at pack q, its moments about the first node, per cell (nine), and the offsets."""
    base, f = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    v = [once(f[0] * 0.0) for _ in range(3)]
    B = [once(f[0] * 0.0) for _ in range(9)]
    for l in range(LANES):  # as in `scatter_pack`
        if is_awake(fields, q, l):
            w = [lane_weights(wx, l), lane_weights(wy, l), lane_weights(wz, l)]
            value, moment_i, moment_j, moment_k = gather(
                ti.static(NodeValues(fields.grid.nodes, SingleLayer())), [once(base[d][l]) for d in range(3)],
                fields.real, w, [moments(w[0]), moments(w[1]), moments(w[2])], 1)
            for r in ti.static(range(3)):
                v[r][l] = value[r]
                B[3 * r][l] = moment_i[r]
                B[3 * r + 1][l] = moment_j[r]
                B[3 * r + 2][l] = moment_k[r]
    return v, B, f


@ti.func
def zero_padding_lanes(P: ti.template(), q, filled):
    """Zero the padding lanes of the last pack of a body; otherwise they gather from massless nodes and diverge."""
    for l in ti.static(range(1, LANES)):
        if l >= filled:
            for d in ti.static(range(3)):
                P.v[d][q][l] = 0.0
            for i in ti.static(range(9)):
                P.C[i][q][l] = 0.0


@ti.func
def drift_packs(fields: ti.template(), P: ti.template(), dt, stamp: ti.i32, first, last):
    """Move packs first .. last - 1 for dt [s], and activate the blocks that their stencils reach now."""
    last_key = -1
    for place in range(first, last):
        q = pack_at(fields, place)
        for r in ti.static(range(3)):
            move_pack(fields, P, q, r, dt * P.v[r][q])
        last_key = mark_awake(fields, P, q, last_key, stamp)


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
    displacement is kept. Kahan's own difference (x + displacement) - x is `displacement` to a compiler with fast-math.
    """
    quantum = ti.static(fields.quantum[axis])
    total = remainder + displacement
    count = total * ti.static(1.0 / quantum)
    # to the nearest: remainders with a mean in the direction of motion would be a torque on what turns
    whole = ti.cast(ti.cast(count + ti.max(ti.min(count, NEAREST), -NEAREST), ti.i32), fields.real)
    moved = whole * quantum
    return keep_inside(fields, x + moved, axis), total - moved


@ti.func
def mark_awake(fields: ti.template(), P: ti.template(), q, last_key, stamp: ti.i32):
    """Activate the blocks that the stencils of pack q reach, without those of lanes that sleep; return the last key."""
    asleep = 0
    if ti.static(fields.features.sleep):
        asleep = fields.sleepers.lanes_asleep[q]
    return mark_pack(fields.grid, P.x, q, 1.0 / fields.cell, last_key, stamp, asleep)


@ti.func
def list_blocks(fields: ti.template(), step: ti.template(), first, last):
    """Phase: where mass is transferred, list the active blocks that are in rows first .. last - 1 of all blocks."""
    if step.transfer_mass > 0:
        for row in range(first, last):
            list_row(fields.grid, row, step.stamp)


@ti.func
def drift_before(dt, span: ti.i32):
    """Return the time [s] that particles drift before a stride of `span` substeps: 0 before a single substep."""
    return 0.5 * dt * (span - 1)


@ti.func
def drift_after(dt, span: ti.i32):
    """Return the time [s] that particles drift after a stride of `span` substeps; 0 for span 0, within one."""
    return 0.5 * dt * (span + (span > 0))


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

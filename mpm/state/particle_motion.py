"""Motion of the particles: displacements, compensated in single precision, walls, and the blocks that they reach.
Walls and solids act on nodes. A single grain in a gap of others, near an edge of two walls, weighs too little at its
nodes to be seen, and its neighbours would squeeze it through the wall: `BACKSTOP` is the last barrier."""

from mpm.backend import ti
from mpm.scene.grid import BLOCK
from mpm.state.active_blocks import mark_pack
from mpm.state.ledger import WALL_ROW, credit
from mpm.state.packs import LANES, pack_at

NEAREST = 0.499
"""Quanta by which a displacement is moved away from zero before it is truncated, so that it is rounded to the nearest.
With a half, a remainder of just that would move a particle at rest to and fro."""
BACKSTOP = 0.05
"""Distance [cells] from a wall that can be left, or a static solid, at which a grain is stopped. One of four a cell
rests 0.125 off."""
RECOVERY = 0.01
"""Cells by which a particle is brought out of a moving solid or a shell in a stride: enough against the slow drift of a
fluid towards a face (1e-3), and little where a scene begins with particles inside a tool, or where what flows over the
rim of a shell comes to its side deep in it."""


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


@ti.func
def kept_off_walls(fields: ti.template(), axis: ti.template(), x, v, dt):
    """Return the velocity [m/s] along an axis with which what is at x [m] comes no closer to a wall than `BACKSTOP` in
    dt [s], or no closer than it is; x, v: packs or numbers."""
    table, room = ti.static((fields.parameters.walls, BACKSTOP * fields.cell))
    result = v
    if ti.static(not fields.features.periodic[axis]):
        if table[2 * axis, 4] > 0:
            result = ti.max(result, ti.min((fields.corner + room - x) / dt, 0.0))
        if table[2 * axis + 1, 4] > 0:
            result = ti.min(result, ti.max((fields.corner + fields.span[axis] - room - x) / dt, 0.0))
    return result


@ti.func
def plane_at(fields: ti.template(), x):
    """Return the index plus one, 0 for none, of the static solid at a particle at x [m] (3,), its normal n (3,), and
    the barrier in front of it, where n . place is so much [m]; as they are at the closest node."""
    last = ti.Vector([n - 1 for n in fields.static_contact.owner.shape])
    I = ti.max(ti.min(ti.cast(x / fields.cell + 0.5, ti.i32), last), 0)  # also of a scene that diverges
    owner, n, barrier = 0, 0.0 * x, 0.0 * x[0]
    if fields.static_contact.owned[I // BLOCK] > 0:
        owner = fields.static_contact.owner[I]
        plane = fields.static_contact.plane[I]
        n = ti.Vector([plane[0], plane[1], plane[2]])
        barrier = n.dot(ti.cast(I, fields.real)) * fields.cell - plane[3] + BACKSTOP * fields.cell
    return owner, n, barrier


@ti.func
def push_off(n, barrier, x, v, dt):
    """Return the velocity [m/s] along n that keeps what is at x [m] and moves with v [m/s] (3,) for dt [s] from coming
    closer than a barrier, see `plane_at`, or closer than it is."""
    return ti.max(ti.min(barrier - n.dot(x), 0.0) / dt - v.dot(n), 0.0)


@ti.func
def push_out(fields: ti.template(), approach, depth, dt):
    """Return the speed [m/s] that stops a particle which has come `depth` [m] deep into a solid in dt [s], and the
    distance [m] by which it is moved out besides. approach: its speed along the solid's normal [m/s].
    The move is no velocity: a load at rest in a held tool would be thrown by it in one stride, fall back in the next,
    and so ring with its whole weight."""
    speed = ti.min(ti.max(-approach, 0.0), depth / dt)
    return speed, ti.min(ti.static(RECOVERY * fields.cell), depth - dt * speed)


@ti.func
def stopped_velocity(fields: ti.template(), x, v, dt):
    """Return the velocity [m/s] (3,) that walls and static solids leave a particle at x [m] that moves for dt [s]."""
    u = v
    for d in ti.static(range(3)):
        u[d] = kept_off_walls(fields, d, x[d], v[d], dt)
    if ti.static(len(fields.features.static_colliders) > 0):
        owner, n, barrier = plane_at(fields, x)
        if owner > 0:
            u += push_off(n, barrier, x, u, dt) * n
    return u


@ti.func
def stop_pack(fields: ti.template(), P: ti.template(), step: ti.template(), q, v: ti.template(), dt):
    """Limit the velocity of pack q, which is about to move for dt [s], as walls and static solids do; credit them."""
    change = 0.0 * v[0]
    for d in ti.static(range(3)):
        change += ti.abs(kept_off_walls(fields, d, P.x[d][q], v[d], dt) - v[d])
    for l in range(LANES):
        if (ti.static(len(fields.features.static_colliders) > 0) or change[l] > 0.0) \
                and P.volume[q][l] > 0.0 and not is_at_shell(fields, P, q, l):
            x, u = ti.Vector([P.x[d][q][l] for d in range(3)]), ti.Vector([v[d][l] for d in range(3)])
            kept = stop_at_barriers(fields, step, x, u, P.volume[q][l] * density_of(fields, q), dt)
            for d in ti.static(range(3)):
                v[d][l] = kept[d]


@ti.func
def stop_at_barriers(fields: ti.template(), step: ti.template(), x, v, mass, dt):
    """Return `stopped_velocity` of a particle of a mass [kg]; credit the walls and static solids."""
    u, place = v, ti.cast(x, ti.f64) + fields.world_origin()
    for d in ti.static(range(3)):
        u[d] = kept_off_walls(fields, d, x[d], v[d], dt)
        if u[d] != v[d]:
            credit_wall(fields, step, d, place, mass * (u[d] - v[d]))
    if ti.static(len(fields.features.static_colliders) > 0):
        owner, n, barrier = plane_at(fields, x)
        push = push_off(n, barrier, x, u, dt)
        if owner > 0 and push > 0:
            credit(step.out, fields.rows.first_collider + owner - 1, place, mass * push * n)
            u += push * n
    return u


@ti.func
def credit_wall(fields: ti.template(), step: ti.template(), axis: ti.template(), place, impulse):
    """Credit the impulse [N s] on a particle at a place [m] along an axis to the wall from which it points away."""
    p = ti.Vector.zero(ti.f64, 3)
    p[axis] = impulse
    wall = fields.rows.walls + 2 * axis + ti.cast(impulse < 0, ti.i32)
    for row in ti.static(range(2)):
        credit(step.out, WALL_ROW if row == 0 else wall, place, p)


@ti.func
def is_at_shell(fields: ti.template(), P: ti.template(), q, l):
    """Return whether a particle has a side of a shell: its velocity comes later, see `gather_across_shells`."""
    result = False
    if ti.static(len(fields.features.shells) > 0):
        result = P.side[q][l] != 0.0
    return result


@ti.func
def density_of(fields: ti.template(), q):
    """Return the density [kg/m^3] of the body that pack q belongs to."""
    density = fields.parameters.densities[0]
    for body in range(1, fields.parameters.densities.shape[0]):
        if q >= fields.particles.range_table[body][0]:
            density = fields.parameters.densities[body]
    return density

"""Flow through small holes of shells: a law in place of what the grid cannot resolve.

At the end of each stride a hole takes up the mass that Beverloo's law passes in that time. Once a share of a particle's
mass is due, half of it on average over the holes, the nearest particle on the inner side is carried to the outer side,
where it leaves as fast as the law's flow through the effective opening; so the mean rate is the law's, however large a
particle is. What this changes of the momentum of the particles is credited to the shell.

While a hole flows, the shell's face around it recedes for the nodes, as fast as the flow asks or faster: nodes at rest
would hold up the bed over a cavity of two cells."""

import math

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, surface_velocity
from mpm.boundaries.mobile_contact import reduce_by_compliance
from mpm.motion.mobile_motion import apply_impulse, write_velocity
from mpm.state.active_blocks import mark_place
from mpm.state.ledger import add, credit
from mpm.state.packs import read_lane
from mpm.state.particle_motion import keep_inside

REACH = 1.5
"""Cells from the disc of a hole within which a particle on the inner side covers it. The grid does not see a cavity of
less than a cell; a larger one collapses."""
MOST = 4
"""Particles that a hole lets through at the end of a stride at most; what is due then stays due."""
SMOOTHING = 4e-3
"""Time constant [s] over which a shell's acceleration is averaged: a host gives its motion in steps of 1 to 2 ms."""
MEMORY = 0.1
"""Time constant [s] over which the square of this acceleration is averaged: two periods of 20 Hz."""
PATCH = 1.0  # cells around the disc of a hole in which the face recedes while it flows
SURPLUS = 2.0
"""How much faster the face recedes than the flow asks, because a patch of few nodes has no exact area: the bed's own
pressure holds it back."""
HELD_BACK = 0.25
"""Share of the speed of release below which a particle in front of a hole blocks it."""
TURN = 0.618034
"""By how much of a particle's mass, modulo one, the share that has to be due differs from one hole to the next: equal
holes do not pass their particles at once. The golden ratio leaves no large gaps for any number of holes."""
UNCOVERED, BLOCKED = -1, -2
"""What `find_next` returns where no particle covers a hole, and where one does that another blocks."""
DIAMETER, OPENING, DISCHARGE, AVALANCHE, VIBRATION, OUTER = range(6)  # columns of `OrificeFields.numbers`
DUE = 3  # lane of a hole's first pack: mass due
SQUARE, PRESENT, PASSED, RECEDING = range(4)  # lanes of its second pack


@ti.func
def pass_orifices(fields: ti.template(), step: ti.template(), first, last):
    """Phase: at the end of a stride, let particles through the small holes of shells."""
    if step.span > 0:
        for row, index, begin, end in ti.static(fields.features.orifice_rows):
            for h in range(begin, end):
                pass_hole(fields, fields.orifices, step, row, index, h)


@ti.func
def pass_hole(fields: ti.template(), holes: ti.template(), step: ti.template(), row: ti.template(),
              index: ti.template(), h):
    """Let particles through hole h of a shell by the law, see `mpm.Orifice`."""
    R = collider_axes(step.motion, row, step.row)
    arm, axis = R @ holes.position[h], R @ holes.axis[h]
    corner = ti.Vector([ti.cast(fields.origin[d], fields.real) for d in range(3)])
    centre = collider_origin(step.motion, row, step.row) + arm - corner
    motion = surface_velocity(step.motion, row, step.row, arm)
    elapsed = step.dt * step.span
    gravity = fields.parameters.gravity[None]
    pull = (gravity - ti.cast(note_acceleration(holes, h, motion, elapsed), fields.real)).dot(axis)
    opening = holes.numbers[h, OPENING]
    goes_on, is_covered = 0, 0
    if pull > 0 and opening > 0:
        goes_on = 1
    for k in range(MOST):
        if goes_on > 0:
            goes_on = 0
            speed = 4.0 / math.pi * holes.numbers[h, DISCHARGE] * ti.sqrt(pull * opening)
            n = find_next(fields, fields.particles, index, h, centre, axis, motion, speed)
            if n != UNCOVERED:
                is_covered = 1
            if n == BLOCKED:
                take_up(holes, h, 0.0, 0.0, 0.0, gravity.norm())
            if n >= 0:
                slot = fields.shells.slot[n]
                mass = fields.shells.mass[n]
                density = mass / read_lane(fields.particles.volume, slot)
                if k == 0:
                    flow = 0.25 * math.pi * opening * opening * speed
                    patch = math.pi * patch_radius(fields, holes, h) ** 2
                    take_up(holes, h, density * flow * elapsed, density, SURPLUS * flow / patch, gravity.norm())
                if holes.state[2 * h][DUE] >= due_share(h) * mass:
                    carry(fields, fields.particles, holes, step, row, index, h, n, centre, axis, motion, speed)
                    goes_on = 1
    if is_covered == 0:
        holes.state[2 * h + 1][PRESENT] = 0.0
        holes.state[2 * h + 1][RECEDING] = 0.0


@ti.func
def due_share(h):
    """Return the share of a particle's mass that has to be due at hole h for the particle to pass."""
    turns = 0.5 + TURN * ti.cast(h, ti.f64)
    return turns - ti.floor(turns)


@ti.func
def note_acceleration(holes: ti.template(), h, motion, elapsed):
    """Take up the shell's velocity [m/s] at a hole after a time [s]; return its acceleration [m/s^2], smoothed."""
    before = holes.state[2 * h]
    other = holes.state[2 * h + 1]
    now = ti.cast(motion, ti.f64)
    mean = ti.Vector([before[0], before[1], before[2]])
    if other[SQUARE] < 0.0:  # its first stride
        mean, other[SQUARE] = now, 0.0
    time = ti.cast(elapsed, ti.f64)
    mean += (1.0 - ti.exp(-time / SMOOTHING)) * (now - mean)
    acceleration = (now - mean) / SMOOTHING
    other[SQUARE] = other[SQUARE] + (1.0 - ti.exp(-time / MEMORY)) * (acceleration.dot(acceleration) - other[SQUARE])
    holes.state[2 * h] = ti.Vector([mean[0], mean[1], mean[2], before[DUE]])
    holes.state[2 * h + 1] = other
    return acceleration


@ti.func
def take_up(holes: ti.template(), h, mass, density, receding, gravity):
    """Add a mass [kg] to what is due at a covered hole, and let its face recede [m/s], unless it is jammed."""
    other = holes.state[2 * h + 1]
    other[RECEDING] = 0.0
    if ti.sqrt(2.0 * other[SQUARE]) >= ti.cast(holes.numbers[h, VIBRATION] * gravity, ti.f64):
        other[PRESENT] = 0.0
    if other[PRESENT] < ti.cast(holes.numbers[h, AVALANCHE] * density, ti.f64):
        other[PRESENT] = other[PRESENT] + ti.cast(mass, ti.f64)
        other[RECEDING] = ti.cast(receding, ti.f64)
        holes.state[2 * h][DUE] = holes.state[2 * h][DUE] + ti.cast(mass, ti.f64)
    holes.state[2 * h + 1] = other


@ti.func
def patch_radius(fields: ti.template(), holes: ti.template(), h):
    """Return the radius [m] about a hole in which the face recedes while it flows."""
    return 0.5 * holes.numbers[h, DIAMETER] + PATCH * fields.cell


@ti.func
def receding_velocity(fields: ti.template(), holes: ti.template(), step: ti.template(), index: ti.template(), place,
                      material):
    """Return the velocity [m/s] (3,) at which a shell's face recedes at a node, besides that of the shell.
    place: of the node [m] (3,). material: sign of the side on which the node's material is."""
    velocity = ti.Vector.zero(fields.real, 3)
    for row, collider, begin, end in ti.static(fields.features.orifice_rows):
        if ti.static(collider == index):
            for h in range(begin, end):
                speed = ti.cast(holes.state[2 * h + 1][RECEDING], fields.real)
                if speed > 0 and material * holes.numbers[h, OUTER] < 0:
                    R = collider_axes(step.motion, row, step.row)
                    centre = collider_origin(step.motion, row, step.row) + R @ holes.position[h]
                    r = ti.cast(place, fields.real) - centre
                    axis = R @ holes.axis[h]
                    height, radius = r.dot(axis), patch_radius(fields, holes, h)
                    # further along the axis is another wall
                    if ti.abs(height) < radius and (r - height * axis).norm() < radius:
                        velocity += speed * axis
    return velocity


@ti.func
def find_next(fields: ti.template(), P: ti.template(), index: ti.template(), h, centre, axis, motion, speed):
    """Return the place on the list of the particle nearest to a hole on its inner side, UNCOVERED or BLOCKED.
    centre: [m] relative to the grid's node (0, 0, 0). A particle just outside that recedes slower than a share of
    `speed` [m/s] blocks the hole. Those that cover it stay awake."""
    outer = ti.cast(fields.orifices.numbers[h, OUTER], ti.i32) * (index + 1)
    radius = 0.5 * fields.orifices.numbers[h, DIAMETER]
    place = UNCOVERED
    nearest = ti.cast(REACH * fields.cell, fields.real)
    is_blocked = 0
    for n in range(fields.shells.count[None]):
        slot = fields.shells.slot[n]
        side = ti.cast(read_lane(P.side, slot), ti.i32)
        if ti.abs(side) == index + 1:
            r = ti.Vector([read_lane(P.x[d], slot) for d in range(3)]) - centre
            height = r.dot(axis)
            aside = ti.max((r - height * axis).norm() - radius, 0.0)
            distance = ti.sqrt(aside * aside + height * height)
            if side == -outer and distance < ti.static(REACH * fields.cell):
                if ti.static(fields.features.sleep):
                    P.rest[slot[0]][slot[1]] = 0.0
                if distance < nearest:
                    nearest = distance
                    place = n
            if side == outer and aside == 0.0 and ti.abs(height) < 2.0 * read_lane(P.half, slot):
                v = ti.Vector([read_lane(P.v[d], slot) for d in range(3)])
                if (v - motion).dot(axis) < HELD_BACK * speed:
                    is_blocked = 1
    if is_blocked > 0 and place >= 0:
        place = BLOCKED
    return place


@ti.func
def carry(fields: ti.template(), P: ti.template(), holes: ti.template(), step: ti.template(), row: ti.template(),
          index: ti.template(), h, n, centre, axis, motion, speed):
    """Carry listed particle n through hole h, without stress and at a speed [m/s] relative to the shell."""
    slot, mass = fields.shells.slot[n], fields.shells.mass[n]
    outer = holes.numbers[h, OUTER]
    face = fields.parameters.half_thickness[index] + read_lane(P.half, slot)
    x = ti.Vector([read_lane(P.x[d], slot) for d in range(3)])
    v = ti.Vector([read_lane(P.v[d], slot) for d in range(3)])
    aside = x - centre - (x - centre).dot(axis) * axis
    moved = centre + aside * ti.min(0.5 * holes.numbers[h, OPENING] / aside.norm(1e-12), 1.0) \
        + (face - outer * fields.colliders[index].sdf.behind) * axis
    for d in ti.static(range(3)):
        moved[d] = keep_inside(fields, moved[d], d)
    place = ti.cast(x, ti.f64) + fields.world_origin()
    dv = motion + speed * axis - v
    if ti.static(fields.mobile_place[index] >= 0):
        dv = reduce_by_compliance(fields, step, index, place, mass, dv)
    credit(step.out, fields.rows.first_collider + index, place, mass * dv)
    # what the new place and the lost spin change besides: the turning moment about the world's origin
    quarter = 0.25 * fields.cell * fields.cell
    C = [read_lane(P.C[i], slot) for i in ti.static(range(9))]
    spin = quarter * ti.Vector([C[7] - C[5], C[2] - C[6], C[3] - C[1]])
    turning = ti.cast(moved - x, ti.f64).cross(ti.cast(v + dv, ti.f64)) - ti.cast(spin, ti.f64)
    turning *= ti.cast(mass, ti.f64)
    for d in ti.static(range(3)):
        add(step.out, fields.rows.first_collider + index, 3 + d, turning[d])
    if ti.static(fields.mobile_place[index] >= 0):
        apply_impulse(fields, step.mobile, ti.static(fields.mobile_place[index]), 0.0 * turning, -turning)
        for a, line in ti.static(fields.features.mobile_rows):
            write_velocity(step.mobile, step.motion, step.row, a, line)
    for d in ti.static(range(3)):
        P.x[d][slot[0]][slot[1]] = moved[d]
        P.v[d][slot[0]][slot[1]] = v[d] + dv[d]
    for i in ti.static(range(9)):
        P.C[i][slot[0]][slot[1]] = 0.0
    for i in ti.static(range(6)):
        P.e[i][slot[0]][slot[1]] = 0.0
    if ti.static(fields.features.volume_correction):
        P.vc[slot[0]][slot[1]] = 0.0
    P.side[slot[0]][slot[1]] = outer * (index + 1)
    P.gap[slot[0]][slot[1]] = outer * face
    mark_place(fields.grid, moved, 1.0 / fields.cell, step.stamp + step.span)
    holes.state[2 * h][DUE] = holes.state[2 * h][DUE] - mass
    holes.state[2 * h + 1][PASSED] = holes.state[2 * h + 1][PASSED] + mass

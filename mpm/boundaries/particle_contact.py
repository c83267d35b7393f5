"""Contact of particles with solids: which nodes carry grains that touch, and what has entered a moving solid.
Grid nodes cannot stop the last few particles at a curved or thin wall, and would let a fluid pile up at its face: this
keeps the material's edge there. It takes the approach velocity, and moves the particle out gently."""

from mpm.backend import once, ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, surface_velocity
from mpm.boundaries.mobile_contact import reduce_by_compliance, turn_by_shift
from mpm.boundaries.periodic import home_node
from mpm.state.active_blocks import mark_place
from mpm.state.contact_fields import rank_of, sort_by_part, take_place
from mpm.state.ledger import credit
from mpm.state.nodes import stencil
from mpm.state.packs import LANES, is_active, lowest_bit, pack_at, packs_of_body
from mpm.state.particle_motion import BACKSTOP, drift_after, move_lane, plane_at, push_out

CONTACT_GAP = 0.02
"""Cells between a particle's cube and a solid within which it touches. Grains at rest stay within it; with 0.05 sand
that lands at 0.2 and 0.45 m/s stays 2.0 and 2.9 % too high, with 0.02 it stays 0.8 and 1.7 % too high."""
LOOK_AHEAD = 0.34
"""Cells within which a particle can come to touch in half of a stride: it travels 0.19 cells at most, a solid 0.13."""


@ti.func
def stop_penetration(fields: ti.template(), step: ti.template(), first, last):
    """Phase: stop the particles of packs first .. last - 1 whose cubes a moving solid has entered; credit the solid."""
    if step.span > 0:
        dt = drift_after(fields, step)
        places = [once(collider_origin(step.motion, k, step.row)) for k in range(len(fields.features.moving_solids))]
        axes = [once(collider_axes(step.motion, k, step.row)) for k in range(len(fields.features.moving_solids))]
        for body in range(fields.parameters.densities.shape[0]):
            begin, end = packs_of_body(fields, body, first, last)
            for place in range(begin, end):
                q = pack_at(fields, place)
                for k, index in ti.static(enumerate(fields.features.moving_solids)):
                    near = find_near_lanes(fields, fields.particles, index, q, axes[k], places[k], 0.0)
                    while near > 0:
                        lane = lowest_bit(near)
                        near -= 1 << lane
                        if ti.static(fields.stops_later):
                            note_penetrating(fields, step.part, k, body, q, lane)
                        else:
                            stop_particle(fields, fields.particles, step, k, index, axes[k], places[k], q, lane, dt,
                                          fields.parameters.densities[body])


@ti.func
def note_touching(fields: ti.template(), step: ti.template(), first, last):
    """Phase: where a stride begins, note the nodes of those particles of packs first .. last - 1 that touch a solid.
    Particles touch where their cubes come within `CONTACT_GAP`, or do so in half of the rest of the stride."""
    if step.transfer_mass > 0:
        time = 0.5 * (step.stride - step.dt)
        places = [once(collider_origin(step.motion, k, step.row)) for k in range(len(fields.features.moving_solids))]
        axes = [once(collider_axes(step.motion, k, step.row)) for k in range(len(fields.features.moving_solids))]
        for place in range(first, last):
            q = pack_at(fields, place)
            for k, index in ti.static(enumerate(fields.features.moving_solids)):
                near, touching = find_near_lanes(fields, fields.particles, index, q, axes[k], places[k], LOOK_AHEAD), 0
                while near > 0:
                    lane = lowest_bit(near)
                    near -= 1 << lane
                    x, v, half = lane_of(fields.particles, q, lane)
                    r = ti.Vector([x[d] + fields.origin[d] - places[k][d] for d in range(3)])
                    n_t, phi = fields.colliders[index].sdf.at(axes[k].transpose() @ r)
                    approach = (v - surface_velocity(step.motion, k, step.row, r)).dot(axes[k] @ n_t)
                    if phi + time * ti.min(approach, 0.0) < half + CONTACT_GAP * fields.cell:
                        touching |= 1 << lane
                note_nodes(fields, k, q, touching, step.stamp)
            if ti.static(len(fields.features.static_colliders) > 0):
                touching = 0
                for lane in range(LANES):
                    x, v, half = lane_of(fields.particles, q, lane)
                    owner, n, barrier = plane_at(fields, x)
                    phi = n.dot(x) - barrier + BACKSTOP * fields.cell
                    if owner > 0 and half > 0 and is_active(fields, q, lane) \
                            and phi + time * ti.min(v.dot(n), 0.0) < half + CONTACT_GAP * fields.cell:
                        touching |= 1 << lane
                note_nodes(fields, fields.features.static_row, q, touching, step.stamp)


@ti.func
def note_nodes(fields: ti.template(), row: ti.template(), q, lanes, stamp):
    """Note the nodes of lanes of pack q, one bit each, as touching; row: see `GridFields.touching`."""
    left = lanes
    while left > 0:
        lane = lowest_bit(left)
        left -= 1 << lane
        x, _v, _h = lane_of(fields.particles, q, lane)
        base, _f = stencil(fields.grid, [x[d] / fields.cell for d in range(3)])
        for a, b, c in ti.static(ti.ndrange(3, 3, 3)):
            J = ti.Vector([base[0] + a, base[1] + b, base[2] + c])
            if ti.static(fields.is_periodic):
                J = home_node(fields, J)
            for layer in ti.static(range(fields.grid.layers)):
                fields.grid.touching[row, J[0] + layer * fields.grid.width, J[1], J[2]] = stamp


@ti.func
def lane_of(P: ti.template(), q, lane):
    """Return place [m] (3,), velocity [m/s] (3,) and half of the edge [m] of one lane of pack q."""
    return ti.Vector([P.x[d][q][lane] for d in range(3)]), ti.Vector([P.v[d][q][lane] for d in range(3)]), \
        P.half[q][lane]


@ti.func
def note_penetrating(fields: ti.template(), part, k: ti.template(), body, q, lane):
    """List lane `lane` of pack q, near the k-th moving solid, for `stop_penetrating`."""
    place = take_place(fields.penetrating.count, None)
    fields.penetrating.particle[place] = ti.Vector([k, body, q, lane])
    if ti.static(fields.parts > 0):
        fields.penetrating.part[place] = part
    else:
        fields.penetrating.part[place] = (q * ti.static(len(fields.features.moving_solids)) + k) * LANES + lane


@ti.func
def order_penetrating(fields: ti.template(), step: ti.template(), first, last):
    """Phase: rank what a GPU has listed for `stop_penetrating`, by particle; a thread of each pack takes some."""
    if step.span > 0:
        count = fields.penetrating.count[None]
        for turn in range((count - first + fields.particles.n_packs - 1) // fields.particles.n_packs):
            place = first + turn * fields.particles.n_packs
            fields.penetrating.order[rank_of(fields.penetrating.part, place, count)] = place


@ti.func
def stop_penetrating(fields: ti.template(), step: ti.template(), first, last):
    """Phase: stop the particles that several threads have listed, one after the other, as each moves mobile solids."""
    if step.span > 0:
        dt = drift_after(fields, step)
        count = fields.penetrating.count[None]
        if ti.static(fields.parts > 0):
            sort_by_part(fields.penetrating.order, fields.penetrating.part, fields.penetrating.begins, 0, count)
        for n in range(count):
            particle = fields.penetrating.particle[fields.penetrating.order[n]]
            for k, index in ti.static(enumerate(fields.features.moving_solids)):
                if particle[0] == k:
                    stop_particle(fields, fields.particles, step, k, index, collider_axes(step.motion, k, step.row),
                                  collider_origin(step.motion, k, step.row), particle[2], particle[3], dt,
                                  fields.parameters.densities[particle[1]])
        fields.penetrating.count[None] = 0


@ti.func
def find_near_lanes(fields: ti.template(), P: ti.template(), index: ti.template(), q, R, place, room: ti.template()):
    """Return the lanes of pack q, one bit each, whose cubes may come within `room` cells of a solid at R, place; most
    are far away."""
    d2 = (P.x[0][q] + fields.origin[0] - place[0]) ** 2 + (P.x[1][q] + fields.origin[1] - place[1]) ** 2 \
        + (P.x[2][q] + fields.origin[2] - place[2]) ** 2
    near = 0
    if d2.min() < ti.static((fields.colliders[index].sdf.radius + (0.5 + room) * fields.cell) ** 2):
        half = P.half[q] + ti.static(room * fields.cell)
        r = [once(P.x[d][q] + (fields.origin[d] - place[d])) for d in range(3)]
        z = [once(R[0, d] * r[0] + R[1, d] * r[1] + R[2, d] * r[2]) for d in range(3)]
        for l in ti.static(range(LANES)):
            y = ti.Vector([z[d][l] for d in range(3)])
            if P.half[q][l] > 0 and is_active(fields, q, l) and not fields.colliders[index].sdf.is_beyond(y, half[l]):
                near |= 1 << l
    return near


@ti.func
def stop_particle(fields: ti.template(), P: ti.template(), step: ti.template(), k: ti.template(), index: ti.template(),
                  R, place_of_solid, q, lane, dt, density):
    """Correct velocity and position of one particle that has moved for dt [s], where its cube is in the solid."""
    x = ti.Vector([P.x[d][q][lane] for d in range(3)])
    r = ti.Vector([x[d] + fields.origin[d] - place_of_solid[d] for d in range(3)])
    half = P.half[q][lane]
    y = R.transpose() @ r
    if r.norm_sqr() < ti.static((fields.colliders[index].sdf.radius + 0.5 * fields.cell) ** 2):
        n_t, phi = fields.colliders[index].sdf.at(y)
        if phi < half:
            v = ti.Vector([P.v[d][q][lane] for d in range(3)])
            normal = R @ n_t
            approach = (v - surface_velocity(step.motion, k, step.row, r)).dot(normal)
            mass = density * P.volume[q][lane]
            # the particle acts where it was before the move: x - dt v
            place = ti.Vector([ti.cast(x[d] - dt * v[d], ti.f64) + fields.origin[d] for d in range(3)])
            push, out = push_out(fields, approach, half - phi, dt)
            dv, shift = push * normal, out * normal
            if ti.static(fields.mobile_place[index] >= 0):
                dv = reduce_by_compliance(fields, step, index, place, mass, dv)
            credit(step.out, fields.rows.first_collider + index, place, mass * dv)
            turn_by_shift(fields, step, index, mass, shift, v + dv)
            for d in ti.static(range(3)):
                P.v[d][q][lane] = v[d] + dv[d]
            mark_place(fields.grid, move_lane(fields, P, q, lane, dt * dv + shift), 1.0 / fields.cell,
                       step.stamp + step.span)

"""Adjoint of the correction of particles that have entered the tool."""

from mpm.adjoint.node_contact import surface_back
from mpm.backend import once, ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, surface_velocity
from mpm.boundaries.penetration import SOLID_RECOVERY
from mpm.state.packs import LANES, lane_mask
from mpm.transfers.particle_motion import drift_after, keep_inside
from mpm.transfers.to_particles import gather_pack


@ti.func
def stop_penetration_back(a: ti.template(), step: ti.template()):
    """Adjoint of `stop_penetration`, on the adjoints of velocity and position of particles that have moved.

    The particles hold the positions before the move, the nodes their velocities; leaves in `a.after` what particles
    near the tool had before the correction.
    """
    if step.span > 0:
        for index in ti.static(a.fields.features.moving_solids):
            stop_at_tool_back(a.fields, a.fields.particles, a.bars, a.after, index, step.motion, step.row,
                              drift_after(step.dt, step.span), step.motion_bar)


@ti.func
def stop_at_tool_back(fields: ti.template(), P: ti.template(), B: ti.template(), after: ti.template(),
                      index: ti.template(), motion: ti.template(), s: ti.i32, dt, motion_bar: ti.template()):
    """Reverse the correction at one tool of particles that have moved for dt [s]."""
    centre, R = once(collider_origin(motion, 0, s)), once(collider_axes(motion, 0, s))
    reach = ti.static((fields.colliders[index].sdf.radius + 0.5 * fields.cell) ** 2)
    for q in range(P.pack_count[None]):
        d2 = (after.x[0][q] + fields.origin[0] - centre[0]) ** 2 + (after.x[1][q] + fields.origin[1] - centre[1]) ** 2 \
            + (after.x[2][q] + fields.origin[2] - centre[2]) ** 2
        # the correction moves a particle by a small part of a cell
        if d2.min() < ti.static((fields.colliders[index].sdf.radius + 0.6 * fields.cell) ** 2):
            v, _B, _f = gather_pack(fields, P, q)
            for d in ti.static(range(3)):
                after.v[d][q] = v[d]
                after.x[d][q] = keep_inside(fields, P.x[d][q] + dt * v[d], d)
            for lane in range(LANES):
                mask = lane_mask(lane, fields.real)
                r = ti.Vector([after.x[d][q].dot(mask) + fields.origin[d] - centre[d] for d in range(3)])
                half = P.half[q].dot(mask)
                y = R.transpose() @ r
                if r.norm_sqr() < reach and half > 0 and not fields.colliders[index].sdf.is_beyond(y, half):
                    n_t, phi = fields.colliders[index].sdf.at(y)
                    if phi < half:
                        v_l = ti.Vector([v[d].dot(mask) for d in range(3)])
                        v_bar = ti.Vector([B.v[d][q].dot(mask) for d in range(3)])
                        x_bar = ti.Vector([B.x[d][q].dot(mask) for d in range(3)])
                        normal = R @ n_t
                        relative = v_l - surface_velocity(motion, 0, s, r)
                        approach = relative.dot(normal)
                        correction = ti.max(-approach, 0.0) + SOLID_RECOVERY * fields.cell / dt
                        push_bar = (v_bar + dt * x_bar).dot(normal)
                        normal_bar = ti.min(correction, (half - phi) / dt) * (v_bar + dt * x_bar)
                        approach_bar, phi_bar = 0.0 * push_bar, 0.0 * push_bar
                        if correction >= (half - phi) / dt:
                            phi_bar = -push_bar / dt
                        elif approach < 0:
                            approach_bar = -push_bar
                        normal_bar += approach_bar * relative
                        relative_bar = approach_bar * normal
                        r_bar = surface_back(fields, index, motion, motion_bar, s, R, r, y, n_t,
                                             -relative_bar, normal_bar, phi_bar)
                        for d in ti.static(range(3)):
                            B.v[d][q] = B.v[d][q] + relative_bar[d] * mask
                            B.x[d][q] = B.x[d][q] + r_bar[d] * mask

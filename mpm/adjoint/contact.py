"""Adjoint of contact, of nodes and of particles that have entered the tool, to the motion of the tool."""

from mpm.adjoint.coulomb import coulomb_back, surface_back
from mpm.adjoint.shell_contact import collide_with_shell_back
from mpm.backend import once, ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, coulomb, surface_velocity
from mpm.boundaries.facing import FACE, deciding_node, touched_face, touches_static
from mpm.boundaries.particle_contact import SOLID_RECOVERY
from mpm.scene.grid import BLOCK
from mpm.state.ledger import position
from mpm.state.nodes import in_first_layer
from mpm.state.packs import LANES, is_near, lane_mask
from mpm.state.particle_motion import drift_after, keep_inside, stopped_velocity
from mpm.transfers.to_particles import gather_pack


@ti.func
def update_nodes_back(a: ti.template(), step: ti.template()):
    """Adjoint of `update_nodes`: from the adjoints of node velocities and masses to those of momenta and masses."""
    gravity, origin = a.fields.parameters.gravity[None], a.fields.world_origin()
    for n in range(a.fields.grid.count[None]):
        block = a.fields.grid.active[n] * BLOCK
        for i, j in ti.ndrange(BLOCK, BLOCK):
            for k in range(BLOCK):
                I = block + ti.Vector([i, j, k])
                q = a.nodes.folded[step.place, I[0], I[1], I[2]]
                if q[3] > 0:
                    bar = a.nodes.bars[I]
                    free = ti.Vector([q[0], q[1], q[2]]) / q[3]
                    v_bar = ti.Vector([bar[0], bar[1], bar[2]])
                    if ti.static(len(a.fields.colliders) > 0):
                        v_bar = collide_back(a, step, I, free + step.kick * gravity, origin, v_bar)
                    p_bar = v_bar / q[3]
                    mass_bar = a.nodes.bars[I][3] - p_bar.dot(free)  # a neighbour's normal may have added to it
                    a.nodes.bars[I] = ti.Vector([p_bar[0], p_bar[1], p_bar[2], mass_bar])


@ti.func
def collide_back(a: ti.template(), step: ti.template(), I, before, corner, bar):
    """Return the adjoint of a node's velocity before contact with the static colliders and then with the tool.
    Whether the node's material touches a face is taken as it is."""
    v, v_bar, static_normal, owner = before, bar, 0.0 * before, 0
    J = in_first_layer(a.fields.grid, I)
    if ti.static(len(a.fields.features.static_colliders) > 0):
        owner = a.fields.static_contact.owner[J]
        if owner > 0:
            contact = a.fields.static_contact.plane[J]
            static_normal = ti.Vector([contact[0], contact[1], contact[2]])
            if contact[3] >= FACE * a.fields.cell \
                    or not touches_static(a.fields, a.nodes, step.place, I, static_normal):
                owner = 0
        if owner > 0:
            v = coulomb(before, before * 0.0, static_normal, a.fields.parameters.frictions[owner - 1])
    if ti.static(len(a.fields.features.shells) > 0):
        v_bar = collide_with_shell_back(a, step, I, J, v, corner, v_bar)
    for index in ti.static(a.fields.features.moving_solids):
        r = ti.cast(position(I, corner, a.fields.cell), a.fields.real) - collider_origin(step.motion, 0, step.row)
        if r.norm_sqr() < ti.static((a.fields.colliders[index].sdf.radius + FACE * a.fields.cell) ** 2):
            R = collider_axes(step.motion, 0, step.row)
            y = R.transpose() @ r
            if not a.fields.colliders[index].sdf.is_beyond(y, FACE * a.fields.cell):
                surface = surface_velocity(step.motion, 0, step.row, r)
                normal, n_t, of_material = touched_face(
                    a.fields, a.nodes, step.place, I, 0, a.fields.colliders[index].sdf, R, y)
                if normal.norm_sqr() > 0:
                    v_bar, surface_bar, normal_bar = coulomb_back(v, surface, normal,
                                                                  a.fields.parameters.frictions[index], v_bar)
                    if of_material:  # the material's, which the tool does not turn
                        material_normal_back(a, step.place, I, normal, normal_bar)
                        normal_bar = 0.0 * normal_bar
                    surface_back(a.fields, index, step.motion, step.motion_bar, step.row, R, r, y, n_t, surface_bar,
                                 normal_bar, ti.cast(0.0, a.fields.real))
    if owner > 0:
        v_bar, _s, _n = coulomb_back(before, before * 0.0, static_normal, a.fields.parameters.frictions[owner - 1],
                                     v_bar)
    return v_bar


@ti.func
def material_normal_back(a: ti.template(), k, I, normal, normal_bar):
    """Add the adjoints of the masses about node I by which `touched_face` has found the normal of its material."""
    J, _here, above, below = deciding_node(a.fields, a.nodes, k, I)
    slope_bar = (normal_bar - normal * normal.dot(normal_bar)) / (above - below).norm(1e-30)
    for d in ti.static(range(3)):
        e = ti.Vector([int(c == d) for c in range(3)])
        if above[d] != below[d]:  # else a wall mirrors the one, or neither is there
            a.nodes.bars[J + e][3] += slope_bar[d]
            a.nodes.bars[J - e][3] -= slope_bar[d]


@ti.func
def stop_penetration_back(a: ti.template(), step: ti.template()):
    """Adjoint of `stop_penetration`, on the adjoints of velocity and position of particles that have moved.
    The particles hold the positions before the move, the nodes their velocities; leaves in `a.after` what particles
    near the tool had before the correction."""
    if step.span > 0:
        for index in ti.static(a.fields.features.moving_solids):
            stop_at_tool_back(a, a.fields, a.fields.particles, a.bars, index, step, drift_after(a.fields, step))


@ti.func
def stop_at_tool_back(a: ti.template(), fields: ti.template(), P: ti.template(), B: ti.template(), index: ti.template(),
                      step: ti.template(), dt):
    """Reverse the correction at one tool of particles that have moved for dt [s]."""
    after, motion, s = ti.static((a.after, step.motion, step.row))
    centre, R = once(collider_origin(motion, 0, s)), once(collider_axes(motion, 0, s))
    reach = ti.static((fields.colliders[index].sdf.radius + 0.5 * fields.cell) ** 2)
    for q in range(P.pack_count[None]):
        # the correction moves a particle by a small part of a cell
        if is_near(fields, after.x, q, centre, fields.colliders[index].sdf.radius + 0.6 * fields.cell):
            v, _B, _f, _masses = gather_pack(fields, P, q)
            for l in range(LANES):
                x, free = ti.Vector([P.x[d][q][l] for d in range(3)]), ti.Vector([v[d][l] for d in range(3)])
                kept = stopped_velocity(fields, x, free, dt)
                for d in ti.static(range(3)):
                    v[d][l] = kept[d]
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
                        r_bar = surface_back(fields, index, motion, step.motion_bar, s, R, r, y, n_t, -relative_bar,
                                             normal_bar, phi_bar)
                        for d in ti.static(range(3)):
                            B.v[d][q] = B.v[d][q] + relative_bar[d] * mask
                            B.x[d][q] = B.x[d][q] + r_bar[d] * mask

"""Adjoint of contact, of nodes and of particles that have entered the tool, to the motion of the tool."""

from mpm.adjoint.backstop import push_out_back
from mpm.adjoint.coulomb import coulomb_back, distance_back, face_back, velocity_back
from mpm.adjoint.shell_contact import collide_with_shell_back
from mpm.backend import once, ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, coulomb, surface_velocity
from mpm.boundaries.facing import deciding_node, has_touching_grains
from mpm.boundaries.node_contact import bit_of, half_stride
from mpm.scene.grid import BLOCK
from mpm.state.ledger import position
from mpm.state.nodes import in_first_layer
from mpm.state.packs import LANES, is_near, lane_mask
from mpm.state.particle_motion import drift_after, keep_inside, push_out, stopped_velocity
from mpm.transfers.to_particles import gather_pack


@ti.func
def update_nodes_back(a: ti.template(), step: ti.template()):
    """Adjoint of `update_nodes`: from the adjoints of node velocities and masses to those of momenta and masses."""
    gravity, origin = a.fields.parameters.gravity[None], a.fields.world_origin()
    if step.place == 0:
        a.nodes.add_mass_bars(a.fields.grid)
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
    Whether the node's material touches a face is taken as the stride's first update of nodes has decided it; the normal
    is of that moment, the velocity of the surface that of the substep."""
    v, v_bar, static_normal, owner = before, bar, 0.0 * before, 0
    touches = a.fields.grid.contact[I // BLOCK]
    J = in_first_layer(a.fields.grid, I)
    if ti.static(len(a.fields.features.static_colliders) > 0):
        owner = a.fields.static_contact.owner[J]
        if owner > 0:
            contact = a.fields.static_contact.plane[J]
            static_normal = ti.Vector([contact[0], contact[1], contact[2]])
            if touches & 1 == 0 or not has_touching_grains(a.fields, a.fields.features.static_row, I):
                owner = 0
        if owner > 0:
            v = coulomb(before, before * 0.0, static_normal, a.fields.parameters.frictions[owner - 1])
    if ti.static(len(a.fields.features.shells) > 0):
        v_bar = collide_with_shell_back(a, step, I, J, v, corner, v_bar)
    for index in ti.static(a.fields.features.moving_solids):
        if touches & ti.static(bit_of(0)) > 0 and has_touching_grains(a.fields, 0, I):
            place = ti.cast(position(J, corner, a.fields.cell), a.fields.real)
            face, r = a.fields.grid.face[0, I[0], I[1], I[2]], place - collider_origin(step.motion, 0, step.row)
            normal = ti.Vector([face[0], face[1], face[2]])
            v_bar, surface_bar, normal_bar = coulomb_back(v, surface_velocity(step.motion, 0, step.row, r), normal,
                                                          a.fields.parameters.frictions[index], v_bar)
            if face[3] > 0:  # the material's, which the tool does not turn
                material_normal_back(a, step.place, I, normal, normal_bar)
                normal_bar = 0.0 * normal_bar
            face_back(a, step, 0, index, place, normal, surface_bar, normal_bar, half_stride(step))
    if owner > 0:
        v_bar, _s, _n = coulomb_back(before, before * 0.0, static_normal, a.fields.parameters.frictions[owner - 1],
                                     v_bar)
    return v_bar


@ti.func
def material_normal_back(a: ti.template(), k, I, normal, normal_bar):
    """Add the adjoints of the masses about node I by which `touched_face` has found the normal of its material.
    They are those of the stride's first update of nodes; k: number of the one that is reversed."""
    J, _here, above, below = deciding_node(a.fields, a.nodes, I)
    slope_bar = (normal_bar - normal * normal.dot(normal_bar)) / (above - below).norm(1e-30)
    for d in ti.static(range(3)):
        e = ti.Vector([int(c == d) for c in range(3)])
        if above[d] != below[d]:  # else a wall mirrors the one, or neither is there
            for side in ti.static((1, -1)):
                if k > 0:
                    a.nodes.mass_bars[J + side * e] += side * slope_bar[d]
                else:
                    a.nodes.bars[J + side * e][3] += side * slope_bar[d]


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
            v, _B, _f, _masses, _around = gather_pack(fields, P, q)
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
                        speed, out = push_out(fields, approach, half - phi, dt)
                        speed_bar = v_bar + dt * x_bar
                        approach_bar, depth_bar = push_out_back(fields, approach, half - phi, dt, speed_bar.dot(normal),
                                                                x_bar.dot(normal))
                        normal_bar = speed * speed_bar + out * x_bar
                        normal_bar += approach_bar * relative
                        relative_bar = approach_bar * normal
                        r_bar = velocity_back(step, s, r, -relative_bar) \
                            + distance_back(fields, index, step, s, R, r, n_t, normal_bar, -depth_bar)
                        for d in ti.static(range(3)):
                            B.v[d][q] = B.v[d][q] + relative_bar[d] * mask
                            B.x[d][q] = B.x[d][q] + r_bar[d] * mask

"""Adjoint of contact with a shell, of nodes and of particles that would enter it, to the motion of the tool.
It is constant in the derivative on which side of the shell nodes and particles are."""

from mpm.adjoint.backstop import push_out_back
from mpm.adjoint.coulomb import coulomb_back, distance_back, face_back, velocity_back
from mpm.adjoint.side_layers import gathered_velocity, side_of
from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, surface_velocity
from mpm.boundaries.shell_transfer import WATCHED, lever_after
from mpm.state.ledger import position
from mpm.state.packs import LANES
from mpm.state.particle_motion import drift_after, keep_inside, push_out, stopped_velocity


@ti.func
def collide_with_shell_back(a: ti.template(), step: ti.template(), I, J, v, corner, bar):
    """Return the adjoint of a node's velocity before `collide_with_shell`; J: the node in the first layer.
    The normal is that of the begin of the stride, the velocity of the surface that of the substep."""
    v_bar, side = bar, a.fields.shells.side[J]
    if side != 0:
        gap = a.fields.shells.gap[J]
        own = I[0] < a.fields.grid.width
        material = ti.cast(1 if (side > 0) == own else -1, a.fields.real)
        for row, index in ti.static(a.fields.features.shell_rows):
            face = a.fields.parameters.half_thickness[index] \
                + a.fields.colliders[index].sdf.face_cells * a.fields.cell
            if ti.abs(side) == index + 1 and material * gap[3] < face:
                normal = material * ti.Vector([gap[0], gap[1], gap[2]])
                place = ti.cast(position(J, corner, a.fields.cell), a.fields.real)
                r = place - collider_origin(step.motion, row, step.row)
                v_bar, surface_bar, normal_bar = coulomb_back(v, surface_velocity(step.motion, row, step.row, r),
                                                              normal, a.fields.parameters.frictions[index], bar)
                face_back(a, step, row, index, place, material * normal, surface_bar, material * normal_bar,
                          0.0 * gap[3])
    return v_bar


@ti.func
def stop_at_shells_back(a: ti.template(), step: ti.template()):
    """Adjoint of `stop_at_shells`, on the adjoints of velocity and position of particles that have moved.
    The particles hold the positions before the move, the nodes their velocities; leaves in `a.after` what particles
    with a side had before they were stopped."""
    if step.span > 0:
        dt = drift_after(a.fields, step)
        for q in range(a.fields.particles.pack_count[None]):
            for l in range(LANES):
                if a.after.side[q][l] != 0:
                    stop_particle_back(a, a.fields.particles, a.bars, step, q, l, dt)


@ti.func
def stop_particle_back(a: ti.template(), P: ti.template(), B: ti.template(), step: ti.template(), q, l, dt):
    """Reverse the stop of one particle that has moved for dt [s]; see `find_entered` and `stop_at_shell`."""
    side = side_of(a.after, q, l)
    x = ti.Vector([P.x[d][q][l] for d in range(3)])
    v = stopped_velocity(a.fields, x, gathered_velocity(a, P, q, l), dt)
    for d in ti.static(range(3)):
        a.after.v[d][q][l] = v[d]
        a.after.x[d][q][l] = keep_inside(a.fields, x[d] + dt * v[d], d)
    for row, index in ti.static(a.fields.features.shell_rows):
        own = ti.cast(1 if side > 0 else -1, a.fields.real)
        thick = a.fields.parameters.half_thickness[index]
        if ti.abs(side) == index + 1 and own * P.gap[q][l] < thick + WATCHED * a.fields.cell:
            R = collider_axes(step.motion, row, step.row)
            r = lever_after(a.fields, step, row, x + dt * v)
            y = R.transpose() @ r
            n_t, phi, sided = a.fields.colliders[index].sdf.at(y)
            depth = thick + P.half[q][l] - own * phi
            if sided > 0 and depth > 0:
                normal, friction = own * (R @ n_t), a.fields.parameters.frictions[index]
                relative = v - surface_velocity(step.motion, row, step.row, r)
                approach = relative.dot(normal)
                push, out = push_out(a.fields, approach, depth, dt)
                slide = relative - approach * normal
                speed = slide.norm(1e-12)
                held = friction * push / speed
                x_bar = ti.Vector([B.x[d][q][l] for d in range(3)])
                bar = ti.Vector([B.v[d][q][l] for d in range(3)]) + dt * x_bar  # of the stopped velocity
                push_bar, slide_bar = normal.dot(bar), -ti.min(held, 1.0) * bar
                if held < 1.0:
                    held_bar = -slide.dot(bar)
                    push_bar += held_bar * friction / speed
                    slide_bar -= (held_bar * held / (speed * speed)) * slide
                approach_bar, depth_bar = push_out_back(a.fields, approach, depth, dt, push_bar, x_bar.dot(normal))
                approach_bar -= slide_bar.dot(normal)
                relative_bar = slide_bar + approach_bar * normal
                normal_bar = push * bar + out * x_bar - approach * slide_bar + approach_bar * relative
                r_bar = velocity_back(step, step.row, r, -relative_bar) \
                    + distance_back(a.fields, index, step, step.row, R, r, n_t, own * normal_bar, -own * depth_bar)
                for d in ti.static(range(3)):
                    B.v[d][q][l] = B.v[d][q][l] + relative_bar[d]
                    B.x[d][q][l] = B.x[d][q][l] + r_bar[d]

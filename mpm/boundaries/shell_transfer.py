"""Transfers across thin shells, of the particles that have a side of one.
They are few: the packs leave them out, and they are transferred one by one from a list."""

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, surface_velocity
from mpm.boundaries.mobile_contact import reduce_by_compliance, turn_by_shift
from mpm.state.active_blocks import mark_place, note_reached
from mpm.state.contact_fields import take_place
from mpm.state.ledger import credit
from mpm.state.packs import LANES, read_lane
from mpm.state.particle_motion import drift_after, keep_inside, move_lane, push_out, stop_at_barriers
from mpm.state.stencil import NodeValues, ShellLayers, gather, moments, scatter, scatter_shift, weights

WATCHED = 1.3
"""Cells from the shell within which a particle can reach it in a stride: its own travel and the shell's."""


@ti.func
def scatter_across_shells(fields: ti.template(), step: ti.template(), first, last):
    """Phase: scatter the listed particles first .. last - 1 to the layers on which nodes and particles share a side."""
    for c in range(first, last):
        side = ti.cast(read_lane(fields.particles.side, fields.shells.slot[c]), ti.i32)
        f = fields.shells.offset[c]
        if ti.static(fields.parts > 0):
            note_reached(fields.grid, step.part, fields.shells.base[c], -1, step.stamp, 2)
        layers = ti.static(ShellLayers(fields.grid, fields.shells, side, scatter_shift(fields, step)))
        scatter(fields.scatter_target, layers, fields.shells.base[c], fields.shells.q[0][c], fields.shells.q[1][c],
                fields.shells.q[2][c], fields.shells.q[3][c], [weights(f[0]), weights(f[1]), weights(f[2])])


@ti.func
def gather_across_shells(fields: ti.template(), step: ti.template(), first, last):
    """Phase: gather the listed particles first .. last - 1, from the layers that they scattered to.
    At the end of a stride those move that do not enter a shell."""
    dt = drift_after(fields, step)
    for n in range(first, last):
        slot = fields.shells.slot[n]
        side = ti.cast(read_lane(fields.particles.side, slot), ti.i32)
        f = fields.shells.offset[n]
        w = [weights(f[0]), weights(f[1]), weights(f[2])]
        value, moment_i, moment_j, moment_k = gather(
            ti.static(NodeValues(fields.grid.nodes, ShellLayers(fields.grid, fields.shells, side))),
            fields.shells.base[n], fields.real, w, [moments(w[0]), moments(w[1]), moments(w[2])], 1)
        moment = [moment_i, moment_j, moment_k]
        v = ti.Vector([value[0], value[1], value[2]])
        gradient = 4.0 / fields.cell
        for r in ti.static(range(3)):
            for c in ti.static(range(3)):
                fields.particles.C[3 * r + c][slot[0]][slot[1]] = gradient * (moment[c][r] - v[r] * f[c])
        if dt > 0:
            if ti.static(fields.features.density_state):
                fields.particles.noted[slot[0]][slot[1]] = value[3]
            v = stop_at_barriers(fields, step, place_on_list(fields, n), v, fields.shells.mass[n], dt)
        for r in ti.static(range(3)):
            fields.particles.v[r][slot[0]][slot[1]] = v[r]  # not the pack: another thread may hold a lane of it
        if dt > 0:
            entered = find_entered(fields, fields.particles, step, dt, place_on_list(fields, n), v, side, slot)
            fields.shells.entered[n] = entered
            if entered[3] == 0:
                move_listed(fields, step, n, slot, dt * v)
            elif ti.static(fields.shells.lists_entering):
                fields.shells.entering[take_place(fields.shells.entering_count, None)] = n


@ti.func
def order_entering(fields: ti.template(), step: ti.template(), first, last):
    """Phase: rank what a GPU has listed at places first .. last - 1 of those that would enter a shell, by particle."""
    count = fields.shells.entering_count[None]
    for place in range(first, ti.min(last, count)):
        n, rank = fields.shells.entering[place], 0
        slot = fields.shells.slot[n]
        for other in range(count):
            another = fields.shells.slot[fields.shells.entering[other]]
            if another[0] * LANES + another[1] < slot[0] * LANES + slot[1]:
                rank += 1
        fields.shells.entering_order[rank] = n


@ti.func
def place_on_list(fields: ti.template(), n):
    """Return where listed particle n is before its move [m] (3,), relative to the grid's node (0, 0, 0)."""
    return (ti.cast(fields.shells.base[n], fields.real) + fields.shells.offset[n]) * fields.cell


@ti.func
def move_listed(fields: ti.template(), step: ti.template(), n, slot, displacement):
    """Move listed particle n by `displacement` [m] (3,), and activate the blocks that its stencil reaches then."""
    moved = place_on_list(fields, n) + displacement
    if ti.static(len(fields.particles.remainder) > 0):
        moved = move_lane(fields, fields.particles, slot[0], slot[1], displacement)
    else:
        for r in ti.static(range(3)):
            moved[r] = keep_inside(fields, moved[r], r)
            fields.particles.x[r][slot[0]][slot[1]] = moved[r]
    mark_place(fields.grid, moved, 1.0 / fields.cell, step.stamp + step.span)


@ti.func
def find_entered(fields: ti.template(), P: ti.template(), step: ti.template(), dt, x, v, side, slot):
    """Return the normal out of the shell that a particle's cube would enter in a move, and the depth [m]; or zeros."""
    entered = ti.Vector.zero(fields.real, 4)
    for row, index in ti.static(fields.features.shell_rows):
        own = ti.cast(1 if side > 0 else -1, fields.real)
        thick = fields.parameters.half_thickness[index]
        if ti.abs(side) == index + 1 and own * read_lane(P.gap, slot) < thick + WATCHED * fields.cell:
            R = collider_axes(step.motion, row, step.row)
            n_t, phi, sided = fields.colliders[index].sdf.at(R.transpose() @ lever_after(fields, step, row, x + dt * v))
            half = read_lane(P.half, slot)
            depth = thick + half - own * phi
            if sided > 0 and depth > 0:
                normal = own * (R @ n_t)
                entered = ti.Vector([normal[0], normal[1], normal[2], depth])
    return entered


@ti.func
def lever_after(fields: ti.template(), step: ti.template(), row: ti.template(), x):
    """Return the vector [m] from a shell's frame to a place relative to the grid's node (0, 0, 0)."""
    return ti.Vector([x[d] + fields.origin[d] for d in range(3)]) - collider_origin(step.motion, row, step.row)


@ti.func
def stop_at_shells(fields: ti.template(), step: ti.template(), first, last):
    """Phase: stop the listed particles first .. last - 1 that would enter a shell, move them, credit the shell.
    Nodes hold a material back, but not exactly where the shell is, nor each of its particles: this stops the last of
    them, and keeps the material's edge at the shell's face."""
    if step.span > 0:
        dt = drift_after(fields, step)
        for number in range(first, last):
            n = number
            if ti.static(fields.shells.lists_entering):
                n = fields.shells.entering_order[number]
            entered = fields.shells.entered[n]
            if entered[3] > 0:
                slot = fields.shells.slot[n]
                v = ti.Vector([read_lane(fields.particles.v[d], slot) for d in range(3)])
                stopped, shift = stop_at_shell(fields, step, dt, place_on_list(fields, n), v, fields.shells.mass[n],
                                               ti.cast(read_lane(fields.particles.side, slot), ti.i32), entered)
                for r in ti.static(range(3)):
                    fields.particles.v[r][slot[0]][slot[1]] = stopped[r]
                move_listed(fields, step, n, slot, dt * stopped + shift)
        if ti.static(fields.shells.lists_entering):
            fields.shells.entering_count[None] = 0


@ti.func
def stop_at_shell(fields: ti.template(), step: ti.template(), dt, x, v, mass, side, entered):
    """Return velocity and shift that keep a particle out of the shell that it would enter; credit the shell."""
    stopped, shift = v, 0.0 * v
    for row, index in ti.static(fields.features.shell_rows):
        if ti.abs(side) == index + 1:
            normal = ti.Vector([entered[0], entered[1], entered[2]])
            relative = v - surface_velocity(step.motion, row, step.row, lever_after(fields, step, row, x + dt * v))
            approach = relative.dot(normal)
            push, out = push_out(fields, approach, entered[3], dt)
            slide = relative - approach * normal
            held = ti.min(fields.parameters.frictions[index] * push / slide.norm(1e-12), 1.0)
            dv = push * normal - held * slide
            place = ti.Vector([ti.cast(x[d], ti.f64) for d in range(3)]) + fields.world_origin()
            if ti.static(fields.mobile_place[index] >= 0):
                dv = reduce_by_compliance(fields, step, index, place, mass, dv)
            credit(step.out, fields.rows.first_collider + index, place, mass * dv)
            stopped, shift = v + dv, out * normal
            turn_by_shift(fields, step, index, mass, shift, stopped)
    return stopped, shift

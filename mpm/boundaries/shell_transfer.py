"""Transfers across thin shells, of the particles that have a side of one.

They are few: the packs leave them out, and they are transferred one by one from a list.
"""

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, surface_velocity
from mpm.boundaries.mobile_contact import reduce_by_compliance
from mpm.state.active_blocks import mark_place
from mpm.state.ledger import credit
from mpm.state.packs import lane_mask, read_lane, write_lane
from mpm.transfers.particle_grid import NodeValues, ShellLayers, gather, moments, scatter, weights
from mpm.transfers.to_particles import drift_after, keep_inside

WATCHED = 1.3
"""Cells from the shell within which a particle can reach it in a stride: its own travel and the shell's."""
SHELL_RECOVERY = 0.2
"""Cells by which a particle's next position is corrected at most."""


@ti.func
def scatter_across_shells(fields: ti.template(), step: ti.template(), first, last):
    """Phase: scatter the listed particles to the layers on which nodes and particles share a side."""
    for c in range(fields.shells.count[None]):
        side = ti.cast(read_lane(fields.particles.side, fields.shells.slot[c]), ti.i32)
        f = fields.shells.offset[c]
        scatter(fields.grid.nodes, ti.static(ShellLayers(fields.grid, fields.shells, side)), fields.shells.base[c],
                fields.shells.q[0][c], fields.shells.q[1][c], fields.shells.q[2][c], fields.shells.q[3][c],
                [weights(f[0]), weights(f[1]), weights(f[2])])


@ti.func
def gather_across_shells(fields: ti.template(), step: ti.template(), first, last):
    """Phase: gather the listed particles again, from the layers that they scattered to.

    At the end of a stride they move, and those that would pass a shell are stopped.
    """
    dt = drift_after(step.dt, step.span)
    for n in range(fields.shells.count[None]):
        slot = fields.shells.slot[n]
        side = ti.cast(read_lane(fields.particles.side, slot), ti.i32)
        f = fields.shells.offset[n]
        w = [weights(f[0]), weights(f[1]), weights(f[2])]
        value, moment_i, moment_j, moment_k = gather(
            ti.static(NodeValues(fields.grid.nodes, ShellLayers(fields.grid, fields.shells, side))),
            fields.shells.base[n], fields.real, w, [moments(w[0]), moments(w[1]), moments(w[2])], 1)
        moment = [moment_i, moment_j, moment_k]
        v = ti.Vector([value[0], value[1], value[2]])
        x = (ti.cast(fields.shells.base[n], fields.real) + f) * fields.cell
        free = v
        if dt > 0:
            v = stop_at_shell(fields, fields.particles, step, dt, x, free, fields.shells.mass[n], side, slot)
        mask = lane_mask(slot[1], fields.real)
        gradient = 4.0 / fields.cell
        moved = x + dt * v
        for r in ti.static(range(3)):
            moved[r] = keep_inside(fields, moved[r], r)
            write_lane(fields.particles.v[r], slot[0], mask, v[r])
            for c in ti.static(range(3)):
                write_lane(fields.particles.C[3 * r + c], slot[0], mask, gradient * (moment[c][r] - free[r] * f[c]))
        if dt > 0:
            for r in ti.static(range(3)):
                write_lane(fields.particles.x[r], slot[0], mask, moved[r])
            mark_place(fields.grid, moved, 1.0 / fields.cell, step.stamp + step.span)


@ti.func
def stop_at_shell(fields: ti.template(), P: ti.template(), step: ti.template(), dt, x, v, mass, side, slot):
    """Return a particle's velocity, corrected where it would carry its cube into the shell; credit the shell.

    Nodes hold a material back, but not exactly where the shell is, nor each of its particles: this stops the last of
    them, and keeps the material's edge at the shell's face.
    """
    result = v
    for row, index in ti.static(fields.features.shell_rows):
        own = ti.cast(1 if side > 0 else -1, fields.real)
        thick = fields.parameters.half_thickness[index]
        if ti.abs(side) == index + 1 and own * read_lane(P.gap, slot) < thick + WATCHED * fields.cell:
            place_of_shell = collider_origin(step.motion, row, step.row)
            R = collider_axes(step.motion, row, step.row)
            r = ti.Vector([x[d] + fields.origin[d] + dt * v[d] - place_of_shell[d] for d in range(3)])
            n_t, phi, sided = fields.colliders[index].sdf.at(R.transpose() @ r)
            half = 0.5 * ti.pow(read_lane(P.volume, slot), 1.0 / 3.0)
            depth = thick + half - own * phi
            if sided > 0 and depth > 0:
                normal = own * (R @ n_t)
                push = ti.min(depth, SHELL_RECOVERY * fields.cell) / dt
                slide = v - surface_velocity(step.motion, row, step.row, r)
                slide = slide - slide.dot(normal) * normal
                held = ti.min(fields.parameters.frictions[index] * push / slide.norm(1e-12), 1.0)
                dv = push * normal - held * slide
                place = ti.Vector([ti.cast(x[d], ti.f64) for d in range(3)]) + fields.world_origin()
                if ti.static(fields.mobile_place[index] >= 0):
                    dv = reduce_by_compliance(fields, step, index, place, mass, dv)
                credit(step.out, fields.rows.first_collider + index, place, mass * dv)
                result = v + dv
    return result

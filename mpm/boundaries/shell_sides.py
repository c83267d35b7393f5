"""Sides of thin shells: which side of a shell nodes and particles are on.
A particle within reach of a shell keeps the side on which it came (its label) until it leaves the neighbourhood or
passes the rim. Towards nodes on the other side it writes to, and reads from, the second layer of the grid: there its
material meets the shell, and nothing else."""

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin
from mpm.geometry.shell import FAR
from mpm.scene.grid import BLOCK
from mpm.state.active_blocks import activate
from mpm.state.contact_fields import take_place
from mpm.state.ledger import position
from mpm.state.nodes import first_nodes, node_of
from mpm.state.packs import LANES, is_active, lane_mask, pack_at, write_lane

CURVATURE = 0.5
"""Cells by which a curved shell may come closer to a stencil's outer nodes than its tangent plane."""


@ti.func
def label_nodes(fields: ti.template(), step: ti.template(), first, last):
    """Phase: where mass is transferred, label the nodes of active blocks first .. last - 1 near a shell.
    Activates the second layer of blocks that hold a label; empties the list of labelled particles."""
    if step.transfer_mass > 0:
        fields.shells.count[None] = 0
        corner = fields.world_origin()
        for n in range(first, last):
            block = fields.grid.active[n]
            near = 0
            for row, index in ti.static(fields.features.shell_rows):
                middle = position(block * BLOCK, corner, fields.cell) + 0.5 * (BLOCK - 1) * fields.cell
                r = ti.cast(middle, fields.real) - collider_origin(step.motion, row, step.row)
                if r.norm() < fields.colliders[index].sdf.radius + 2.6 * fields.cell:
                    near = 1
            if near > 0 or fields.shells.labelled[block] > 0 or ti.static(step.threads > 1):
                sides = 0
                for m in range(BLOCK**3 // step.threads):
                    sides += label_node(fields, step.motion, step.row, near,
                                        node_of(block, step.threads * m + step.thread), corner)
                if sides > 0:
                    activate(fields.grid, block + ti.Vector([fields.grid.width // BLOCK, 0, 0]), step.stamp)
                fields.shells.labelled[block] = near


@ti.func
def label_node(fields: ti.template(), motion: ti.template(), s: ti.i32, near: ti.i32, I, corner):
    """Store side, shell and gap of a node; return whether it has a side."""
    closest = ti.cast(FAR, fields.real)
    side, shell = 0, 0
    if near > 0:  # else the block has gone out of reach
        for row, index in ti.static(fields.features.shell_rows):
            R = collider_axes(motion, row, s)
            r = ti.cast(position(I, corner, fields.cell), fields.real) - collider_origin(motion, row, s)
            n_t, phi, sided = fields.colliders[index].sdf.at(R.transpose() @ r)
            if ti.abs(phi) < closest:
                closest = ti.abs(phi)
                shell = index + 1
                side = sided * shell * (1 if phi >= 0 else -1)
                n = R @ n_t
                fields.shells.gap[I] = ti.Vector([n[0], n[1], n[2], phi])
    fields.shells.shell[I] = shell
    fields.shells.side[I] = side
    return ti.abs(side)


@ti.func
def reaches_across(fields: ti.template(), J):
    """Return whether some node of the stencil about node J can lie on the other side of the closest shell."""
    gap = fields.shells.gap[J]
    return ti.abs(gap[3]) < (ti.abs(gap[0]) + ti.abs(gap[1]) + ti.abs(gap[2]) + CURVATURE) * fields.cell


@ti.func
def label_particles(fields: ti.template(), step: ti.template(), first, last):
    """Phase: label particles with the side on which they came near a shell, as long as they are near it.
    Where mass is transferred, those of packs first .. last - 1."""
    if step.transfer_mass > 0:
        label_packs(fields, fields.particles, step.motion, step.row, first, last)


@ti.func
def label_packs(fields: ti.template(), P: ti.template(), motion: ti.template(), s: ti.i32, first, last):
    """Label the particles of packs first .. last - 1, see `label_particles`."""
    for place in range(first, last):
        q = pack_at(fields, place)
        near = 0
        for row, index in ti.static(fields.features.shell_rows):
            c_t = collider_origin(motion, row, s)
            d2 = (P.x[0][q] + fields.origin[0] - c_t[0]) ** 2 + (P.x[1][q] + fields.origin[1] - c_t[1]) ** 2 \
                + (P.x[2][q] + fields.origin[2] - c_t[2]) ** 2
            if d2.min() < fields.colliders[index].sdf.radius ** 2:
                near = 1
        if near > 0 or ti.abs(P.side[q]).sum() > 0:
            nodes = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)[0]
            for l in range(LANES):
                J = ti.Vector([nodes[d].dot(lane_mask(l, ti.i32)) + 1 for d in range(3)])
                mask = lane_mask(l, fields.real)
                before = ti.cast(P.side[q].dot(mask), ti.i32)
                x = ti.Vector([P.x[d][q].dot(mask) + fields.origin[d] for d in range(3)])
                side, phi = find_side(fields, motion, s, J, x)
                if (side != 0 and ti.abs(before) == ti.abs(side)) or not is_active(fields, q, l):
                    side = before
                if P.volume[q].dot(mask) == 0:  # padding, which would be listed, and gather from nodes without mass
                    side = 0
                write_lane(P.gap, q, mask, phi)
                write_lane(P.side, q, mask, ti.cast(side, fields.real))


@ti.func
def find_side(fields: ti.template(), motion: ti.template(), s: ti.i32, J, x):
    """Return side label and signed distance [m] of a particle at x whose stencil lies about node J; 0: no side."""
    side = 0
    gap = ti.cast(FAR, fields.real)
    if fields.shells.labelled[J // BLOCK] > 0 and fields.shells.shell[J] > 0 and reaches_across(fields, J):
        for row, index in ti.static(fields.features.shell_rows):
            if fields.shells.shell[J] == index + 1:
                y = collider_axes(motion, row, s).transpose() @ (x - collider_origin(motion, row, s))
                _n, phi, sided = fields.colliders[index].sdf.at(y)
                gap = phi
                side = sided * (index + 1) * (1 if phi >= 0 else -1)
    return side, gap


@ti.func
def list_particles(fields: ti.template(), step: ti.template(), first, last):
    """Phase: where mass is transferred, list the particles of packs first .. last - 1 that have a side."""
    if step.transfer_mass > 0:
        for place in range(first, last):
            list_lanes(fields, fields.particles, pack_at(fields, place))


@ti.func
def list_lanes(fields: ti.template(), P: ti.template(), q):
    """List the lanes of pack q that have a side, for the transfers across shells of the whole stride."""
    if ti.abs(P.side[q]).sum() > 0:
        for l in range(LANES):
            if P.side[q][l] != 0 and is_active(fields, q, l):
                c = take_place(fields.shells.count, None)
                fields.shells.slot[c] = ti.Vector([q, l])
                fields.shells.place[q][l] = c

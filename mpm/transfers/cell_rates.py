"""Rate of volume of fluids, averaged over the particles of a cell.
Every particle of a fluid has a volume of its own, and so a condition on the velocities of the nodes: with eight of them
a cell that is more than nodes can meet, and the fluid resists shear like a soft solid (volumetric locking). A mean over
the cell leaves one condition a cell, as reduced integration does for finite elements (Hughes 1980, Int. J. Numer.
Methods Eng. 15, 1413)."""

from mpm.backend import is_shared, once, ti
from mpm.scene.grid import BLOCK
from mpm.state.nodes import first_nodes, node_of
from mpm.state.packs import LANES, pack_at, packs_of_body


@ti.func
def clear_rates(fields: ti.template(), step: ti.template(), first, last):
    """Phase: zero the sums of the cells that begin in active blocks first .. last - 1."""
    for n in range(first, last):
        if ti.static(step.threads > 1):
            fields.cell_rates[node_of(fields.grid.active[n], step.thread)] = ti.Vector.zero(fields.real, 2)
        else:
            corner = fields.grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    fields.cell_rates[corner + ti.Vector([a, b, c])] = ti.Vector.zero(fields.real, 2)


@ti.func
def sum_rates(fields: ti.template(), step: ti.template(), first, last):
    """Phase: add the rates of volume, and the volumes, of fluid particles in packs first .. last - 1 to their cells."""
    for index, law in ti.static(enumerate(fields.laws)):
        if ti.static(law.state == "volume"):
            for body in range(fields.parameters.densities.shape[0]):
                if ti.static(len(fields.laws) == 1) or fields.parameters.law_index[body] == index:
                    begin, end = packs_of_body(fields, body, first, last)
                    for place in range(begin, end):
                        add_pack(fields, fields.particles, pack_at(fields, place))


@ti.func
def add_pack(fields: ti.template(), P: ti.template(), q):
    """Add pack q to the sums of its cells; padding lanes have no volume."""
    rate = P.volume[q] * (P.C[0][q] + P.C[4][q] + P.C[8][q])
    base, f = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)
    for l in range(LANES):
        I = cell_of(fields, P, q, l, base, f)
        both = ti.Vector([rate[l], P.volume[q][l]])
        if ti.static(is_shared()):
            ti.atomic_add(fields.cell_rates[I], both)
        else:
            fields.cell_rates[I] = fields.cell_rates[I] + both


@ti.func
def with_mean_rate(fields: ti.template(), P: ti.template(), law: ti.template(), q, C: ti.template()):
    """Return the velocity gradient C of pack q, of a fluid with the mean rate of volume of its cell as the trace."""
    if ti.static(fields.features.cell_rates and law.state == "volume"):
        excess = (C[0] + C[4] + C[8] - mean_rates(fields, P, q)) / 3.0
        return [once(C[i] - excess) if ti.static(i in (0, 4, 8)) else C[i] for i in range(9)]
    else:
        return C


@ti.func
def mean_rates(fields: ti.template(), P: ti.template(), q):
    """Return the mean rate of volume [1/s] in the cell of each particle of pack q."""
    base, f = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)
    mean = 0.0 * f[0]
    for l in range(LANES):
        total = fields.cell_rates[cell_of(fields, P, q, l, base, f)]
        if total[1] > 0:
            mean[l] = total[0] / total[1]
    return mean


@ti.func
def cell_of(fields: ti.template(), P: ti.template(), q, l, base: ti.template(), f: ti.template()):
    """Return the node that the cell of a particle begins with, of the layer of its side of a shell.
    base, f: first nodes and offsets of pack q."""
    I = ti.Vector([base[d][l] + ti.cast(f[d][l] >= 1.0, ti.i32) for d in ti.static(range(3))])
    if ti.static(len(fields.features.shells) > 0):
        side = ti.cast(P.side[q][l], ti.i32)
        if side != 0 and fields.shells.side[I] == -side:
            I[0] += fields.grid.width
    return I

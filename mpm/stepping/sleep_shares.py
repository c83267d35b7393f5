"""Particles that fall asleep and wake: what they give to nodes is added to the nodes' sums, or taken away again."""

from mpm.backend import once, ti
from mpm.materials.material import PARAMETERS
from mpm.materials.stress_update import current_stress
from mpm.materials.symmetric_tensor import FULL
from mpm.scene.grid import BLOCK
from mpm.state.nodes import first_nodes
from mpm.state.packs import LANES
from mpm.state.sleepers import FORCE, MASS, list_awake_packs, place_of_block
from mpm.transfers.particle_grid import weights


@ti.func
def apply_changes(fields: ti.template()):
    """Bring the nodes' sums up to who sleeps now, and list the packs that are awake.

    The only place that adds shares is also the one that takes them away, so that both are the same to the bit.
    """
    for index, law in ti.static(enumerate(fields.laws)):
        for body in range(fields.parameters.densities.shape[0]):
            if ti.static(len(fields.laws) == 1) or fields.parameters.law_index[body] == index:
                p = [once(fields.parameters.law[body, i]) for i in range(PARAMETERS)]
                ends = fields.particles.range_table[body]
                for q in range(ends[0], ends[1]):
                    changed = fields.sleepers.lanes_asleep[q] ^ fields.sleepers.lanes_summed[q]
                    if changed != 0:
                        tau = current_stress(fields, fields.particles, law, q, p)
                        change_pack(fields, fields.particles, q, changed, fields.parameters.densities[body], tau)
    write_changed_blocks(fields)
    list_awake_packs(fields)


@ti.func
def write_changed_blocks(fields: ti.template()):
    """Write what sleepers give to the nodes of blocks where that has changed."""
    quanta = ti.Vector([fields.sleepers.limits[FORCE], fields.sleepers.limits[FORCE], fields.sleepers.limits[FORCE],
                        fields.sleepers.limits[MASS]])
    for block in ti.grouped(ti.ndrange(*fields.sleepers.changed.shape)):
        if fields.sleepers.changed[block] > 0:
            fields.sleepers.changed[block] = 0
            for a, b, c in ti.ndrange(BLOCK, BLOCK, BLOCK):
                I = block * BLOCK + ti.Vector([a, b, c])
                sums = fields.sleepers.sums[I]
                fields.sleepers.given[I] = ti.Vector([ti.cast(quanta[d] * ti.cast(sums[d], ti.f64), fields.real)
                                                      for d in range(4)])


@ti.func
def change_pack(fields: ti.template(), P: ti.template(), q, changed, density, tau: ti.template()):
    """Add the shares of those of the changed lanes of pack q that sleep now, take away those of the others."""
    inverse_cell = 1.0 / fields.cell
    base, f = first_nodes(fields.grid, P.x, q, inverse_cell)
    force = (-4.0 * inverse_cell) * P.volume[q]
    Q = [once(force * tau[FULL[i]]) for i in range(9)]
    for l in range(LANES):
        if (changed >> l) & 1:
            sign = ti.cast(2 * ((fields.sleepers.lanes_asleep[q] >> l) & 1) - 1, ti.i64)
            node = ti.Vector([base[d][l] for d in range(3)])
            offset = ti.Vector([ti.cast(f[d][l], ti.f64) for d in range(3)])
            rows = ti.Matrix([[ti.cast(Q[3 * r + c][l], ti.f64) for c in range(3)] for r in range(3)])
            add_share(fields, node, offset, rows, ti.cast(density * P.volume[q][l], ti.f64), sign)
            fields.sleepers.home[q][l] = place_of_block(fields, node // BLOCK)
    fields.sleepers.lanes_summed[q] = fields.sleepers.lanes_asleep[q]


@ti.func
def add_share(fields: ti.template(), node, f, Q, mass, sign):
    """Add sign times the share of one particle: force Q (offset of the node) and mass, at the 27 nodes from `node` on.

    f: place of the particle from `node`, in cells. Q: (3, 3) [N] per cell.
    """
    per_force, per_mass = 1.0 / fields.sleepers.limits[FORCE], 1.0 / fields.sleepers.limits[MASS]
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    for i in ti.static(range(3)):
        for j in ti.static(range(3)):
            for k in ti.static(range(3)):
                w = wx[i] * wy[j] * wz[k]
                F = (Q @ (ti.Vector([float(i), float(j), float(k)]) - f)) * (w * per_force)
                quanta = ti.Vector([ti.cast(ti.round(F[0]), ti.i64), ti.cast(ti.round(F[1]), ti.i64),
                                    ti.cast(ti.round(F[2]), ti.i64), ti.cast(ti.round(w * mass * per_mass), ti.i64)])
                I = node + ti.Vector([i, j, k])
                fields.sleepers.sums[I] = fields.sleepers.sums[I] + sign * quanta
    low, high = node // BLOCK, (node + 2) // BLOCK
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                fields.sleepers.shares[i, j, k] = fields.sleepers.shares[i, j, k] + ti.cast(sign, ti.i32)
                fields.sleepers.changed[i, j, k] = 1

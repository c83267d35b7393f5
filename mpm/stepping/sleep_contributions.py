"""Force and mass that sleeping particles give to nodes: summed once, as they fall asleep, and taken away as they wake.
The nodes that they share with particles awake are also watched: how far they move decides who wakes."""

from mpm.backend import once, ti
from mpm.materials.material import PARAMETERS
from mpm.materials.stress_update import current_stress
from mpm.materials.symmetric_tensor import FULL
from mpm.scene.grid import BLOCK, GHOST
from mpm.state.ledger import add, position
from mpm.state.nodes import first_nodes
from mpm.state.packs import LANES
from mpm.state.sleepers import FORCE, MASS, SUPPORT, WAKE_DISPLACEMENT, list_awake_packs, place_of_node
from mpm.state.stencil import weights

NOTICED = 0.05
"""Fraction of the wake displacement from which on a node disturbs the particles that sleep at it."""
LIGHT = 1e-4
"""Fraction of a cell's mass below which a node does not wake its sleepers: its velocity is noise."""


@ti.func
def apply_changes(fields: ti.template()):
    """Bring the nodes' sums up to date with the particles that sleep now, and list the packs that are awake.
    Contributions are added and taken away by the same function, so that both are the same to the bit."""
    for index, law in ti.static(enumerate(fields.laws)):
        for body in range(fields.parameters.densities.shape[0]):
            if ti.static(len(fields.laws) == 1) or fields.parameters.law_index[body] == index:
                p = [once(fields.parameters.law[body, i]) for i in range(PARAMETERS)]
                ends = fields.particles.range_table[body]
                for q in range(ends[0], ends[1]):
                    changed = fields.sleepers.lanes_asleep[q] ^ fields.sleepers.lanes_summed[q]
                    if changed != 0:
                        tau = current_stress(fields, fields.particles, law, q, body, p)
                        change_pack(fields, fields.particles, q, changed, fields.parameters.densities[body], tau)
    write_changed_blocks(fields)
    list_awake_packs(fields)


@ti.func
def write_changed_blocks(fields: ti.template()):
    """Write the contribution of sleepers to the nodes of blocks where it has changed."""
    quanta = ti.Vector([fields.sleepers.limits[FORCE], fields.sleepers.limits[FORCE], fields.sleepers.limits[FORCE],
                        fields.sleepers.limits[MASS]])
    for n in range(fields.sleepers.changed_count[None]):
        block = fields.sleepers.changed_blocks[n]
        fields.sleepers.changed[block] = 0
        for a, b in ti.ndrange(BLOCK, BLOCK):
            for c in ti.static(range(BLOCK)):
                I = block * BLOCK + ti.Vector([a, b, c])
                sums = fields.sleepers.sums[I]
                fields.sleepers.contribution[I] = ti.Vector([ti.cast(quanta[d] * ti.cast(sums[d], ti.f64), fields.real)
                                                             for d in range(4)])
    fields.sleepers.changed_count[None] = 0


@ti.func
def change_pack(fields: ti.template(), P: ti.template(), q, changed, density, tau: ti.template()):
    """Add the contributions of the changed lanes of pack q that sleep now, take away those of the others."""
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
            add_contribution(fields, node, offset, rows, ti.cast(density * P.volume[q][l], ti.f64), sign)
            fields.sleepers.home[q][l] = place_of_node(fields, node)
    fields.sleepers.lanes_summed[q] = fields.sleepers.lanes_asleep[q]


@ti.func
def add_contribution(fields: ti.template(), node, f, Q, mass, sign):
    """Add sign times the contribution of one particle to the 27 nodes from `node` on: force Q (offset) and mass.
    f: place of the particle from `node`, in cells. Q: (3, 3) [N] per cell."""
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
                fields.sleepers.stencil_count[i, j, k] = fields.sleepers.stencil_count[i, j, k] + ti.cast(sign, ti.i32)
                if fields.sleepers.changed[i, j, k] == 0:
                    fields.sleepers.changed[i, j, k] = 1
                    fields.sleepers.changed_blocks[fields.sleepers.changed_count[None]] = ti.Vector([i, j, k])
                    fields.sleepers.changed_count[None] = fields.sleepers.changed_count[None] + 1


@ti.func
def mark_disturbed(fields: ti.template(), I, check):
    """Mark the nodes with which stencils begin that reach node I as disturbed."""
    low = ti.max(I - 2, 0)
    for i in range(low[0], I[0] + 1):
        for j in range(low[1], I[1] + 1):
            for k in range(low[2], I[2] + 1):
                fields.sleepers.disturbed_at[place_of_node(fields, ti.Vector([i, j, k]))] = check
    fields.sleepers.is_disturbed[None] = 1


@ti.func
def add_sleepers(fields: ti.template(), step: ti.template(), first, last):
    """Phase: add the force of sleepers, and where mass is transferred their mass, in active blocks first .. last - 1.
    Nodes that no waking particle has mass at are left alone, at zero: whatever sleeps there is in balance. A wall's
    ghost counts where it is folded to."""
    factors = ti.Vector([step.kick, step.kick, step.kick, ti.cast(step.transfer_mass, fields.real)])
    for n in range(first, last):
        block = fields.grid.active[n]
        if block[0] < fields.grid.width // BLOCK and fields.sleepers.stencil_count[block] > 0:
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block * BLOCK + ti.Vector([a, b, c])
                    q = fields.grid.nodes[I]
                    if q[3] > 0 or is_folded_to_awake(fields, step, I):
                        given = fields.sleepers.contribution[I]
                        if given[3] > 0:
                            fields.grid.nodes[I] = q + factors * given
                            if step.transfer_mass > 0:
                                for row in ti.static(range(fields.features.solids)):  # it lies where it has touched
                                    fields.grid.touching[row, I[0], I[1], I[2]] = step.stamp


@ti.func
def is_folded_to_awake(fields: ti.template(), step: ti.template(), I):
    """Return whether a node is a wall's ghost, of a node that something awake has mass at."""
    J = I
    for d in ti.static(range(3)):
        if ti.static(not fields.features.periodic[d]):
            low, high = ti.static(GHOST, GHOST + fields.cells[d])
            if I[d] < low:
                J[d] = 2 * low - I[d]
            elif I[d] > high:
                J[d] = 2 * high - I[d]
    folded = False
    if (J - I).norm_sqr() > 0 and fields.grid.stamp[J // BLOCK] == step.stamp:
        folded = fields.grid.nodes[J][3] > 0
    return folded


@ti.func
def settle_with_sleepers(fields: ti.template(), step: ti.template(), first, last):
    """Phase: let sleepers support the nodes of active blocks first .. last - 1, and note those that move all the same.
    A sleeper supports a node by its fraction of the node's mass, as static friction does: up to the limit `SUPPORT`.
    The ledger's row `asleep` gets the momentum that they take from nodes, and at the end of a stride the forces of
    sleepers on nodes, less the momentum of their mass, which the next stride begins without."""
    noticed = ti.cast(NOTICED * fields.sleepers.limits[WAKE_DISPLACEMENT], fields.real)
    check = fields.sleepers.check[None] + 1
    time, ends = step.span * step.dt, ti.cast(ti.min(step.span, 1), fields.real)
    light = LIGHT * fields.parameters.densities[0] * fields.cell ** 3
    most = step.kick * ti.cast(fields.sleepers.limits[SUPPORT], fields.real)
    origin = fields.world_origin()
    total, moment = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    for n in range(first, last):
        block = fields.grid.active[n]
        if block[0] < fields.grid.width // BLOCK and fields.sleepers.stencil_count[block] > 0:
            # summed per block about its corner, in the field's precision, as in `update_nodes`
            p, turning = ti.Vector.zero(fields.real, 3), ti.Vector.zero(fields.real, 3)
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block * BLOCK + ti.Vector([a, b, c])
                    q = fields.grid.nodes[I]
                    if q[3] > 0:
                        given = fields.sleepers.contribution[I]
                        if given[3] > 0:
                            v = ti.Vector([q[0], q[1], q[2]])
                            held = ti.min(given[3] / q[3], 1.0) * ti.min(1.0, most / ti.max(v.norm(), 1e-12)) * v
                            v -= held
                            fields.grid.nodes[I] = ti.Vector([v[0], v[1], v[2], q[3]])
                            change = time * ti.Vector([given[0], given[1], given[2]]) - ends * given[3] * v \
                                - q[3] * held
                            p += change
                            turning += ti.Vector([float(a), float(b), float(c)]).cross(change)
                            if given[3] > light:
                                earlier = 0.0 * v
                                if fields.sleepers.window[I] == check:
                                    earlier = fields.sleepers.path[I]
                                path = earlier + step.kick * v
                                fields.sleepers.window[I] = check
                                fields.sleepers.path[I] = path
                                if earlier.norm_sqr() <= noticed * noticed < path.norm_sqr():
                                    mark_disturbed(fields, I, check)
            whole = ti.cast(p, ti.f64)
            total += whole
            moment += position(block * BLOCK, origin, fields.cell).cross(whole) + fields.cell * ti.cast(turning, ti.f64)
    for d in ti.static(range(3)):
        add(step.out, fields.rows.asleep, d, total[d])
        add(step.out, fields.rows.asleep, 3 + d, moment[d])

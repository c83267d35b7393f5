"""Particle to grid: the constitutive update of particles, and the scatter of stress, momentum and mass, in one loop."""

from mpm.backend import once, ti
from mpm.materials.density import numbers_of, take_up_density
from mpm.materials.material import PARAMETERS, stiffens_with_density
from mpm.materials.stress_update import update_stress
from mpm.materials.symmetric_tensor import FULL
from mpm.scene.grid import BLOCK
from mpm.state.active_blocks import note_reached
from mpm.state.ledger import GRAVITY_ROW, add
from mpm.state.nodes import clear, first_nodes, velocities_to_momenta
from mpm.state.packs import LANES, is_active, pack_at, packs_of_body
from mpm.state.sleepers import sleeping_lanes
from mpm.state.stencil import SingleLayer, lane_weights, scatter, scatter_shift, weights
from mpm.transfers.cell_rates import with_mean_rate


@ti.func
def start_nodes(fields: ti.template(), step: ti.template(), first, last):
    """Phase: zero the nodes of active blocks first .. last - 1, or within a stride turn velocities to momenta."""
    if step.transfer_mass > 0:
        clear(fields.grid, step, first, last)
    elif ti.static(fields.features.strides):
        velocities_to_momenta(fields.grid, step, first, last)


@ti.func
def scatter_packs(fields: ti.template(), step: ti.template(), first, last):
    """Phase: update strain and stress of packs first .. last - 1; scatter stress, and mass where it is transferred."""
    for index, law in ti.static(enumerate(fields.laws)):
        for body in range(fields.parameters.densities.shape[0]):
            if ti.static(len(fields.laws) == 1) or fields.parameters.law_index[body] == index:
                begin, end = packs_of_body(fields, body, first, last)
                scatter_body(fields, fields.particles, step, law, body, begin, end)


@ti.func
def scatter_body(fields: ti.template(), P: ti.template(), step: ti.template(), law: ti.template(), body, first, last):
    """Update and scatter the packs at places first .. last - 1, which are of one body."""
    p = [once(fields.parameters.law[body, i]) for i in range(PARAMETERS)]
    density = fields.parameters.densities[body]
    force = -step.kick * 4.0 / (fields.cell * fields.cell)
    for place in range(first, last):
        q = pack_at(fields, place)
        C = [once(P.C[i][q]) for i in range(9)]
        before = [once(field[q]) for field in P.kept_strain]
        if ti.static(stiffens_with_density(law)):  # noqa: SIM102  (decided when compiling)
            if step.transfer_mass > 0:
                take_up_density(fields, P, q, density)
        tau = update_stress(fields, P, law, q, step.strain, with_mean_rate(fields, P, law, q, C),
                            numbers_of(fields, P, law, q, density, p))
        keep_strain_of_sleepers(fields, P, q, before)
        volume = P.volume[q]
        mass = density * volume
        transferred = mass * ti.cast(step.transfer_mass, fields.real)
        momentum = [once(transferred * P.v[d][q]) for d in range(3)]
        if ti.static(fields.features.body_acceleration):
            for d in ti.static(range(3)):
                momentum[d] += step.kick * mass * P.acceleration[d][q]
            credit_acceleration(fields, P, q, step.kick * mass, step.out)
        scatter_pack(fields, P, step, q, momentum, transferred, force * volume, C, tau)


@ti.func
def keep_strain_of_sleepers(fields: ti.template(), P: ti.template(), q, before: ti.template()):
    """Give the lanes of pack q that sleep the strain from before the update: to the bit, as their shares need it."""
    if ti.static(fields.features.sleep):  # noqa: SIM102  (decided when compiling)
        if fields.sleepers.lanes_asleep[q] > 0:
            asleep = sleeping_lanes(fields, q)
            for field, kept in ti.static(zip(P.kept_strain, before)):
                field[q] = ti.select(asleep > 0, kept, field[q])


@ti.func
def credit_acceleration(fields: ti.template(), P: ti.template(), q, factor, out: ti.template()):
    """Credit the impulse of a pack, factor [kg s] times body acceleration, with gravity."""
    for l in ti.static(range(LANES)):
        x = ti.Vector([ti.cast(P.x[d][q][l], ti.f64) + fields.origin[d] for d in range(3)])
        p = ti.cast(factor[l], ti.f64) * ti.Vector([ti.cast(P.acceleration[d][q][l], ti.f64) for d in range(3)])
        moment = x.cross(p)
        for d in ti.static(range(3)):
            add(out, GRAVITY_ROW, d, p[d])
            add(out, GRAVITY_ROW, 3 + d, moment[d])


@ti.func
def scatter_pack(fields: ti.template(), P: ti.template(), step: ti.template(), q, p: ti.template(), mass, force,
                 C: ti.template(), tau: ti.template()):
    """Scatter pack q: momentum p (3), mass, and affine momentum Q = force tau + mass C, per cell.
    Particles with a side of a shell are listed instead, see `scatter_across_shells`."""
    Q = [once((force * tau[FULL[i]] + mass * C[i]) * fields.cell) for i in range(9)]
    base, f = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)
    px = p[0] - Q[0] * f[0] - Q[1] * f[1] - Q[2] * f[2]
    py = p[1] - Q[3] * f[0] - Q[4] * f[1] - Q[5] * f[2]
    pz = p[2] - Q[6] * f[0] - Q[7] * f[1] - Q[8] * f[2]
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    zero, key = fields.parameters.zero[None], -1
    for l in range(LANES):  # unrolled it is a fifth slower, and takes half as long again to compile
        node = [once(base[0][l]), once(base[1][l]), once(base[2][l])]
        listed = 1 - is_active(fields, q, l)
        if ti.static(len(fields.features.shells) > 0):  # noqa: SIM102  (decided when compiling)
            if P.side[q][l] != 0 and listed == 0:
                listed = 1
                hand_over(fields.shells, fields.shells.place[q][l], l, node, f, [px, py, pz], mass, Q,
                          step.transfer_mass)
        if listed == 0:
            if ti.static(fields.parts > 0):
                key = note_reached(fields.grid, step.part, node, key, step.stamp, 1)
                node[0] += scatter_shift(fields, step)
            scatter(fields.scatter_target, ti.static(SingleLayer()), node, ti.Vector([px[l], py[l], pz[l], mass[l]]),
                    ti.Vector([Q[0][l], Q[3][l], Q[6][l], zero]), ti.Vector([Q[1][l], Q[4][l], Q[7][l], zero]),
                    ti.Vector([Q[2][l], Q[5][l], Q[8][l], zero]),
                    [lane_weights(wx, l), lane_weights(wy, l), lane_weights(wz, l)])


@ti.func
def hand_over(shells: ti.template(), c, l, node: ti.template(), f: ti.template(), p: ti.template(), mass,
              Q: ti.template(), transfer_mass):
    """Write what lane l of a pack would have scattered to place c of the list for the transfers across shells."""
    shells.base[c] = ti.Vector([node[0], node[1], node[2]])
    shells.offset[c] = ti.Vector([f[0][l], f[1][l], f[2][l]])
    if transfer_mass > 0:  # later substeps of a stride bring none, for the same list
        shells.mass[c] = mass[l]
    shells.q[0][c] = ti.Vector([p[0][l], p[1][l], p[2][l], mass[l]])
    for d in ti.static(range(3)):
        shells.q[1 + d][c] = ti.Vector([Q[d][l], Q[3 + d][l], Q[6 + d][l], 0.0])


@ti.func
def add_parts(fields: ti.template(), step: ti.template(), first, last):
    """Phase: add the arrays that threads have scattered to, in their order, at active blocks first .. last - 1.
    The arrays are left at zero; the nodes begin at zero, or within a stride at the momenta of the previous substep."""
    for n in range(first, last):
        corner = fields.grid.active[n] * BLOCK
        for a, b in ti.ndrange(BLOCK, BLOCK):
            for c in ti.static(range(BLOCK)):
                I = corner + ti.Vector([a, b, c])
                total = ti.Vector.zero(fields.real, 4)
                if step.transfer_mass == 0:
                    q = fields.grid.nodes[I]
                    total = ti.Vector([q[3] * q[0], q[3] * q[1], q[3] * q[2], q[3]])
                fields.grid.nodes[I] = total
        for part in range(fields.parts):
            if fields.grid.reached[part, fields.grid.active[n]] == step.stamp:
                shift = ti.Vector([part * ti.static(fields.grid.layers * fields.grid.width), 0, 0])
                for a, b in ti.ndrange(BLOCK, BLOCK):
                    for c in ti.static(range(BLOCK)):
                        I = corner + ti.Vector([a, b, c])
                        fields.grid.nodes[I] = fields.grid.nodes[I] + fields.scatter_target[I + shift]
                        fields.scatter_target[I + shift] = ti.Vector.zero(fields.real, 4)

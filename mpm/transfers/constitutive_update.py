"""The constitutive update of particles, and the scatter of the stress that it gives, pack by pack in one loop."""

from mpm.backend import once, ti
from mpm.materials.material import PARAMETERS
from mpm.materials.stress_update import update_stress
from mpm.state.ledger import GRAVITY_ROW, add
from mpm.state.packs import LANES, pack_at, packs_of_body
from mpm.state.sleepers import sleeping_lanes
from mpm.transfers.cell_rates import with_mean_rate
from mpm.transfers.to_grid import scatter_pack


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
    force = -step.dt * 4.0 / (fields.cell * fields.cell)
    for place in range(first, last):
        q = pack_at(fields, place)
        C = [once(P.C[i][q]) for i in range(9)]
        before = [once(field[q]) for field in P.kept_strain]
        tau = update_stress(fields, P, law, q, step.dt, with_mean_rate(fields, P, law, q, C), p)
        keep_strain_of_sleepers(fields, P, q, before)
        volume = P.volume[q]
        mass = density * volume
        transferred = mass * ti.cast(step.transfer_mass, fields.real)
        momentum = [once(transferred * P.v[d][q]) for d in range(3)]
        if ti.static(fields.features.body_acceleration):
            for d in ti.static(range(3)):
                momentum[d] += step.dt * mass * P.acceleration[d][q]
            credit_acceleration(fields, P, q, step.dt * mass, step.out)
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

"""Adjoints of the transfers: that of the gather scatters, that of the scatter gathers."""

from mpm.adjoint.backstop import stop_back
from mpm.adjoint.side_layers import layers_of, side_of
from mpm.adjoint.stress_update import numbers_back, read_list, recompute, stress_back, take_up_density_back
from mpm.backend import once, ti
from mpm.materials.density import numbers_of, take_up_density
from mpm.materials.material import PARAMETERS, stiffens_with_density
from mpm.materials.symmetric_tensor import FULL
from mpm.materials.tensor_adjoint import bar_of_matrix
from mpm.state.nodes import stencil
from mpm.state.packs import LANES
from mpm.state.particle_motion import drift_after
from mpm.state.stencil import AffineProducts, NodeValues, gather, moments, scatter, slopes, weights

STRAINS = 15
"""Number of the first field of a state that a law remembers: those of x, v and C stand before it."""


@ti.func
def add_offset_bars(products: ti.template(), nodes: ti.template(), layers: ti.template(), real: ti.template(),
                    base: ti.template(), q0, a0, a1, a2, w: ti.template(), d: ti.template()):
    """Store the derivatives, by the offsets, of the sum of w(node) (q0 + a0 i + a1 j + a2 k) . nodes[node].
    layers: which node a place means, see `layers_of`. w, d: weights and their slopes, 3 axes x 3. Stores four products
    an axis, not yet summed. They go through memory: a sum over a vector's entries right after it was found makes the
    compiler take the whole transfer apart into scalars (620 ns instead of 470 for a substep and particle)."""
    _total, by_x, by_y, by_z = gather(ti.static(AffineProducts(nodes, layers, q0, a0, a1, a2)), base, real, w, d, 0)
    products[0] = by_x
    products[1] = by_y
    products[2] = by_z


@ti.func
def gather_back(a: ti.template(), step: ti.template()):
    """Adjoint of `gather_packs`: adds to the adjoints of node velocities, sets those of the positions before.
    The particles hold the positions before, `a.after` velocities and positions after, `a.bars` the adjoints after."""
    dt = drift_after(a.fields, step)
    if ti.static(len(a.fields.wall_conditions) > 0 or len(a.fields.features.static_colliders) > 0) and dt > 0:
        stop_back(a, a.fields.particles, a.bars, dt)
    gather_body_back(a, a.fields, a.fields.particles, a.bars, a.after, dt)


@ti.func
def gather_body_back(a: ti.template(), fields: ti.template(), P: ti.template(), B: ti.template(),
                     after: ti.template(), dt):
    """Reverse the gather of all particles, which then moved for dt [s], or stayed for 0."""
    gradient = 4.0 / fields.cell
    zero = fields.parameters.zero[None]
    for slot in range(LANES * P.pack_count[None]):
        q, l = slot // LANES, slot % LANES
        node, f = stencil(fields.grid, [once(P.x[d][q][l] * (1.0 / fields.cell)) for d in range(3)])
        w = [weights(f[0]), weights(f[1]), weights(f[2])]
        G = [once(gradient * B.C[i][q][l]) for i in range(9)]
        moved = [once(inside_bar(fields, after.x[d][q][l], B.x[d][q][l], d, dt)) for d in range(3)]
        u = [once(B.v[r][q][l] + dt * moved[r] - G[3 * r] * f[0] - G[3 * r + 1] * f[1] - G[3 * r + 2] * f[2])
             for r in range(3)]
        mass_bar = zero
        if ti.static(fields.features.density_state):  # noqa: SIM102  (decided when compiling)
            if dt > 0:  # what was noted then replaced what was before
                mass_bar = B.noted[q][l]
                B.noted[q][l] = 0.0
        q0, a0 = ti.Vector([u[0], u[1], u[2], mass_bar]), ti.Vector([G[0], G[3], G[6], zero])
        a1, a2 = ti.Vector([G[1], G[4], G[7], zero]), ti.Vector([G[2], G[5], G[8], zero])
        layers = ti.static(layers_of(fields, side_of(after, q, l)))
        scatter(a.nodes.bars, layers, node, q0, a0, a1, a2, w)
        add_offset_bars(a.products, fields.grid.nodes, layers, fields.real, node, q0, a0, a1, a2, w,
                        [slopes(f[0]), slopes(f[1]), slopes(f[2])])
        for d in ti.static(range(3)):  # C = gradient (B - v f^T)
            through_C = G[d] * after.v[0][q][l] + G[3 + d] * after.v[1][q][l] + G[6 + d] * after.v[2][q][l]
            B.x[d][q][l] = moved[d] + (a.products[d].sum() - through_C) / fields.cell


@ti.func
def inside_bar(fields: ti.template(), x, bar, axis: ti.template(), dt):
    """Return the adjoint of a coordinate before `keep_inside`: none for one that a wall holds."""
    is_held = (dt > 0) & ((x <= fields.corner) | (x >= fields.corner + fields.span[axis]))
    return ti.select(is_held, 0.0 * bar, bar)


@ti.func
def scatter_back(a: ti.template(), step: ti.template()):
    """Adjoint of `scatter_packs`: stress, flow and transfer; the particles hold the state before."""
    a.history.restore_from(step.slot, STRAINS)
    for index, law in ti.static(enumerate(a.fields.laws)):
        for body in range(a.fields.parameters.densities.shape[0]):
            if ti.static(len(a.fields.laws) == 1) or a.fields.parameters.law_index[body] == index:
                scatter_body_back(a, a.fields, a.fields.particles, a.bars, a.intermediates, step, law, body)


@ti.func
def scatter_body_back(a: ti.template(), fields: ti.template(), P: ti.template(), B: ti.template(), T: ti.template(),
                      step: ti.template(), law: ti.template(), body):
    """Reverse the scatter of one body, in three loops: in one the compiler takes everything apart into scalars."""
    p = [once(fields.parameters.law[body, i]) for i in range(PARAMETERS)]
    ends, density = P.range_table[body], fields.parameters.densities[body]
    if ti.static(stiffens_with_density(law)):  # noqa: SIM102  (decided when compiling)
        if step.transfer_mass > 0:
            for q in range(ends[0], ends[1]):
                take_up_density(fields, P, q, density)
    for q in range(ends[0], ends[1]):
        recompute(P, T, law, q, step.strain, read_list(P.C, q), numbers_of(fields, P, law, q, density, p))
    transfer_back(a, fields, P, B, T.tau, density * ti.cast(step.transfer_mass, fields.real),
                  -step.kick * 4.0 / (fields.cell * fields.cell), ends[0], ends[1])
    for q in range(ends[0], ends[1]):
        rate_bar, numbers_bar = stress_back(P, B, T, law, q, step.strain, read_list(P.C, q),
                                            numbers_of(fields, P, law, q, density, p))
        p_bar = numbers_back(a, law, q, density, p, numbers_bar)
        for i in ti.static(range(9)):
            B.C[i][q] = B.C[i][q] + rate_bar[i]
        if ti.static(a.materials):
            for i in ti.static(range(len(p_bar))):
                a.parameter_bars[body, i] = a.parameter_bars[body, i] + ti.cast(p_bar[i].sum(), ti.f64)
    if ti.static(stiffens_with_density(law)):  # noqa: SIM102  (decided when compiling)
        if step.transfer_mass > 0:
            a.history.restore_from(step.slot, STRAINS)
            for q in range(ends[0], ends[1]):
                take_up_density_back(fields, P, B, q, density)


@ti.func
def transfer_back(a: ti.template(), fields: ti.template(), P: ti.template(), B: ti.template(), tau: ti.template(),
                  density, force_per_volume, first, last):
    """Adjoint of `scatter_pack`: adds to B.x, sets B.v and B.C, and replaces the stress tau by its adjoint.
    density: [kg/m^3], 0 where momentum and mass were not transferred."""
    zero = fields.parameters.zero[None]
    for slot in range(LANES * first, LANES * last):
        q, l = slot // LANES, slot % LANES
        node, f = stencil(fields.grid, [once(P.x[d][q][l] * (1.0 / fields.cell)) for d in range(3)])
        w = [weights(f[0]), weights(f[1]), weights(f[2])]
        mass, force = density * P.volume[q][l], force_per_volume * P.volume[q][l]
        Q = [once((force * tau[FULL[i]][q][l] + mass * P.C[i][q][l]) * fields.cell) for i in range(9)]
        p = [once(mass * P.v[r][q][l] - Q[3 * r] * f[0] - Q[3 * r + 1] * f[1] - Q[3 * r + 2] * f[2]) for r in range(3)]
        layers = ti.static(layers_of(fields, side_of(a.after, q, l)))
        g, g_x, g_y, g_z = gather(ti.static(NodeValues(a.nodes.bars, layers)), node, fields.real, w,
                                  [moments(w[0]), moments(w[1]), moments(w[2])], 1)
        add_offset_bars(a.products, a.nodes.bars, layers, fields.real, node, ti.Vector([p[0], p[1], p[2], mass]),
                        ti.Vector([Q[0], Q[3], Q[6], zero]), ti.Vector([Q[1], Q[4], Q[7], zero]),
                        ti.Vector([Q[2], Q[5], Q[8], zero]), w, [slopes(f[0]), slopes(f[1]), slopes(f[2])])
        for d in ti.static(range(3)):
            through_p = Q[d] * g[0] + Q[3 + d] * g[1] + Q[6 + d] * g[2]
            B.x[d][q][l] = B.x[d][q][l] + (a.products[d].sum() - through_p) / fields.cell
            B.v[d][q][l] = mass * g[d]
        Q_bar = [g_x[0] - f[0] * g[0], g_y[0] - f[1] * g[0], g_z[0] - f[2] * g[0],
                 g_x[1] - f[0] * g[1], g_y[1] - f[1] * g[1], g_z[1] - f[2] * g[1],
                 g_x[2] - f[0] * g[2], g_y[2] - f[1] * g[2], g_z[2] - f[2] * g[2]]
        tau_bar = bar_of_matrix(Q_bar)
        for i in ti.static(range(6)):
            tau[i][q][l] = force * fields.cell * tau_bar[i]
        for i in ti.static(range(9)):
            B.C[i][q][l] = mass * fields.cell * Q_bar[i]

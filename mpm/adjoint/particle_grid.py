"""Adjoints of the transfers: that of the gather scatters, that of the scatter gathers."""

from mpm.backend import ti
from mpm.materials.hencky_strain import FULL, keep
from mpm.materials.strain_adjoint import bar_of_matrix
from mpm.scene.grid import stencil
from mpm.state.packs import LANES
from mpm.transfers.particle_grid import gather_lane, scatter_lane, weights


@ti.func
def slopes(f):
    """Derivatives of the quadratic B-spline weights of the three nodes at offset f."""
    return [keep(f - 1.5), keep(2.0 - 2.0 * f), keep(f - 0.5)]


@ti.func
def offset_bar(products: ti.template(), nodes: ti.template(), base: ti.template(), q0, a0, a1, a2,
               w: ti.template(), d: ti.template()):
    """Derivatives by the offsets of the sum of w(node) (q0 + a0 i + a1 j + a2 k) . nodes[node], with weights w and
    their slopes d, three lists of three each: four products into `products` for each axis, not yet summed. They go
    through memory: a sum over a vector's entries right after it was found makes the compiler take the whole transfer
    apart into scalars (620 ns instead of 470 for a substep and grain)."""
    by_x = ti.Vector.zero(nodes.dtype, 4)
    by_y, by_z = by_x, by_x
    q_i = q0
    w_x, d_x = ti.Vector([w[0][0], w[0][1], w[0][2]]), ti.Vector([d[0][0], d[0][1], d[0][2]])
    for i in range(3):  # unrolled it takes an eighth longer to compile, and is no faster
        plane, plane_y, plane_z = ti.Vector.zero(nodes.dtype, 4), ti.Vector.zero(nodes.dtype, 4), \
            ti.Vector.zero(nodes.dtype, 4)
        q_j = q_i
        for j in ti.static(range(3)):
            t0 = q_j * nodes[base[0] + i, base[1] + j, base[2]]
            t1 = (q_j + a2) * nodes[base[0] + i, base[1] + j, base[2] + 1]
            t2 = (q_j + 2.0 * a2) * nodes[base[0] + i, base[1] + j, base[2] + 2]
            row = w[2][0] * t0 + w[2][1] * t1 + w[2][2] * t2
            plane = plane + w[1][j] * row
            plane_y = plane_y + d[1][j] * row
            plane_z = plane_z + w[1][j] * (d[2][0] * t0 + d[2][1] * t1 + d[2][2] * t2)
            q_j = q_j + a1
        by_x = by_x + d_x[i] * plane
        by_y = by_y + w_x[i] * plane_y
        by_z = by_z + w_x[i] * plane_z
        q_i = q_i + a0
    products[0] = by_x
    products[1] = by_y
    products[2] = by_z


@ti.func
def gather_back(products: ti.template(), scene: ti.template(), bars: ti.template(), P: ti.template(), B: ti.template(),
                after: ti.template(), body: ti.template(), dt):
    """Bars of node velocities, added to `bars`, and those of the positions before, left in B.x. P holds the positions
    before, `after` velocities and positions after, B the bars of the state after. dt: time [s] that the grains moved,
    0 where they stayed."""
    gradient = 4.0 / scene.cell
    zero = scene.numbers.zero[None]
    for slot in range(LANES * P.ranges[body][0], LANES * P.ranges[body][1]):
        q, l = slot // LANES, slot % LANES
        node, f = stencil(scene.grid, [keep(P.x[d][q][l] * (1.0 / scene.cell)) for d in range(3)])
        wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
        G = [keep(gradient * B.C[i][q][l]) for i in range(9)]
        moved = [keep(held_bar(scene, after.x[d][q][l], B.x[d][q][l], d, dt)) for d in range(3)]
        u = [keep(B.v[r][q][l] + dt * moved[r] - G[3 * r] * f[0] - G[3 * r + 1] * f[1] - G[3 * r + 2] * f[2])
             for r in range(3)]
        q0, a0 = ti.Vector([u[0], u[1], u[2], zero]), ti.Vector([G[0], G[3], G[6], zero])
        a1, a2 = ti.Vector([G[1], G[4], G[7], zero]), ti.Vector([G[2], G[5], G[8], zero])
        scatter_lane(bars, node, q0, a0, a1, a2, wx, wy, wz)
        offset_bar(products, scene.grid.nodes, node, q0, a0, a1, a2, [wx, wy, wz],
                   [slopes(f[0]), slopes(f[1]), slopes(f[2])])
        for d in ti.static(range(3)):  # C = gradient (B - v f^T)
            through_C = G[d] * after.v[0][q][l] + G[3 + d] * after.v[1][q][l] + G[6 + d] * after.v[2][q][l]
            B.x[d][q][l] = moved[d] + (products[d].sum() - through_C) / scene.cell


@ti.func
def held_bar(scene: ti.template(), x, bar, axis: ti.template(), dt):
    """Bar of a coordinate after a move: none for one that a wall holds."""
    held = (dt > 0) & ((x <= scene.corner) | (x >= scene.corner + scene.span[axis]))
    return ti.select(held, 0.0 * bar, bar)


@ti.func
def scatter_back(products: ti.template(), scene: ti.template(), bars: ti.template(), P: ti.template(),
                 B: ti.template(), tau: ti.template(), body: ti.template(), force_per_volume, fresh):
    """Adjoint of `Substeps.spread`: adds to B.x, sets B.v and B.C, and puts the bar of the stress in its place. fresh:
    whether momentum and mass were spread, too."""
    zero = scene.numbers.zero[None]
    brought = scene.numbers.densities[body] * ti.cast(fresh, scene.grid.nodes.dtype)
    for slot in range(LANES * P.ranges[body][0], LANES * P.ranges[body][1]):
        q, l = slot // LANES, slot % LANES
        node, f = stencil(scene.grid, [keep(P.x[d][q][l] * (1.0 / scene.cell)) for d in range(3)])
        wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
        mass, force = brought * P.volume[q][l], force_per_volume * P.volume[q][l]
        Q = [keep((force * tau[FULL[i]][q][l] + mass * P.C[i][q][l]) * scene.cell) for i in range(9)]
        p = [keep(mass * P.v[r][q][l] - Q[3 * r] * f[0] - Q[3 * r + 1] * f[1] - Q[3 * r + 2] * f[2]) for r in range(3)]
        g, g_x, g_y, g_z = gather_lane(bars, node, wx, wy, wz)
        offset_bar(products, bars, node, ti.Vector([p[0], p[1], p[2], mass]), ti.Vector([Q[0], Q[3], Q[6], zero]),
                   ti.Vector([Q[1], Q[4], Q[7], zero]), ti.Vector([Q[2], Q[5], Q[8], zero]), [wx, wy, wz],
                   [slopes(f[0]), slopes(f[1]), slopes(f[2])])
        for d in ti.static(range(3)):
            through_p = Q[d] * g[0] + Q[3 + d] * g[1] + Q[6 + d] * g[2]
            B.x[d][q][l] = B.x[d][q][l] + (products[d].sum() - through_p) / scene.cell
            B.v[d][q][l] = mass * g[d]
        Q_bar = [g_x[0] - f[0] * g[0], g_y[0] - f[1] * g[0], g_z[0] - f[2] * g[0],
                 g_x[1] - f[0] * g[1], g_y[1] - f[1] * g[1], g_z[1] - f[2] * g[1],
                 g_x[2] - f[0] * g[2], g_y[2] - f[1] * g[2], g_z[2] - f[2] * g[2]]
        tau_bar = bar_of_matrix(Q_bar)
        for i in ti.static(range(6)):
            tau[i][q][l] = force * scene.cell * tau_bar[i]
        for i in ti.static(range(9)):
            B.C[i][q][l] = mass * scene.cell * Q_bar[i]

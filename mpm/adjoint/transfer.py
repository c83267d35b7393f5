"""Adjoints of the transfers: that of the gather scatters, that of the scatter gathers."""

from mpm.backend import ti
from mpm.grid import first_nodes
from mpm.strain import FULL, keep
from mpm.transfer import gather_lane, lane, scatter_lane, weights


@ti.func
def slopes(f):
    """Derivatives of the quadratic B-spline weights of the three nodes at offset f."""
    return [keep(f - 1.5), keep(2.0 - 2.0 * f), keep(f - 0.5)]


@ti.func
def offset_bar(products: ti.template(), l: ti.template(), nodes: ti.template(), base: ti.template(), q0, a0, a1, a2,
               w: ti.template(), d: ti.template()):
    """Derivatives by the offsets of the sum of w(node) (q0 + a0 i + a1 j + a2 k) . nodes[node], with weights w and
    their slopes d, three lists of three each: four products into `products` for each axis, not yet summed."""
    by_x = ti.Vector.zero(nodes.dtype, 4)
    by_y, by_z = by_x, by_x
    q_i = q0
    for i in ti.static(range(3)):
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
        by_x = by_x + d[0][i] * plane
        by_y = by_y + w[0][i] * plane_y
        by_z = by_z + w[0][i] * plane_z
        q_i = q_i + a0
    products[0, l] = by_x
    products[1, l] = by_y
    products[2, l] = by_z


@ti.func
def gather_back(products: ti.template(), scene: ti.template(), bars: ti.template(), P: ti.template(), B: ti.template(),
                after: ti.template(), body: ti.template(), dt):
    """Bars of node velocities, added to `bars`, and those of the positions before, left in B.x. P holds the positions
    before, `after` velocities and positions after, B the bars of the state after."""
    gradient = 4.0 / scene.cell
    zero = scene.numbers.zero[None]
    for q in range(P.ranges[body][0], P.ranges[body][1]):
        base, f = first_nodes(scene.grid, P.x, q, 1.0 / scene.cell)
        w = [weights(f[d]) for d in range(3)]
        s = [slopes(f[d]) for d in range(3)]
        G = [keep(gradient * B.C[i][q]) for i in range(9)]
        moved = [keep(held_bar(scene, after.x[d][q], B.x[d][q], d)) for d in range(3)]
        u = [keep(B.v[r][q] + dt * moved[r] - G[3 * r] * f[0] - G[3 * r + 1] * f[1] - G[3 * r + 2] * f[2])
             for r in range(3)]
        for l in ti.static(range(4)):
            node = [keep(base[d][l]) for d in range(3)]
            q0 = ti.Vector([u[0][l], u[1][l], u[2][l], zero])
            a0 = ti.Vector([G[0][l], G[3][l], G[6][l], zero])
            a1 = ti.Vector([G[1][l], G[4][l], G[7][l], zero])
            a2 = ti.Vector([G[2][l], G[5][l], G[8][l], zero])
            wx, wy, wz = lane(w[0], l), lane(w[1], l), lane(w[2], l)
            scatter_lane(bars, node, q0, a0, a1, a2, wx, wy, wz)
            offset_bar(products, l, scene.grid.nodes, node, q0, a0, a1, a2, [wx, wy, wz],
                              [lane(s[0], l), lane(s[1], l), lane(s[2], l)])
        by = summed(products)
        for d in ti.static(range(3)):  # C = gradient (B - v f^T)
            through_C = G[d] * after.v[0][q] + G[3 + d] * after.v[1][q] + G[6 + d] * after.v[2][q]
            B.x[d][q] = moved[d] + (by[d] - through_C) / scene.cell


@ti.func
def held_bar(scene: ti.template(), x, bar, axis: ti.template()):
    """Bar of a coordinate after a move: none for one that a wall holds."""
    held = (x <= scene.corner) | (x >= scene.corner + scene.span[axis])
    return ti.select(held, 0.0 * bar, bar)


@ti.func
def scatter_back(products: ti.template(), scene: ti.template(), bars: ti.template(), P: ti.template(),
                 B: ti.template(), q, mass, force, C: ti.template(), tau: ti.template()):
    """Adjoint of `Substeps.spread`: adds to B.x, sets B.v, and returns the bars of stress (six) and C (nine)."""
    base, f = first_nodes(scene.grid, P.x, q, 1.0 / scene.cell)
    w = [weights(f[d]) for d in range(3)]
    s = [slopes(f[d]) for d in range(3)]
    Q = [keep((force * tau[FULL[i]] + mass * C[i]) * scene.cell) for i in range(9)]
    p = [keep(mass * P.v[r][q] - Q[3 * r] * f[0] - Q[3 * r + 1] * f[1] - Q[3 * r + 2] * f[2]) for r in range(3)]
    value = [keep(f[0] * 0.0) for _ in range(3)]
    moment = [keep(f[0] * 0.0) for _ in range(9)]
    zero = scene.numbers.zero[None]
    for l in ti.static(range(4)):
        node = [keep(base[d][l]) for d in range(3)]
        wx, wy, wz = lane(w[0], l), lane(w[1], l), lane(w[2], l)
        g, g_i, g_j, g_k = gather_lane(bars, node, wx, wy, wz)
        offset_bar(
            products, l, bars, node, ti.Vector([p[0][l], p[1][l], p[2][l], mass[l]]), ti.Vector([Q[0][l], Q[3][l], Q[6][l], zero]),
            ti.Vector([Q[1][l], Q[4][l], Q[7][l], zero]), ti.Vector([Q[2][l], Q[5][l], Q[8][l], zero]),
            [wx, wy, wz], [lane(s[0], l), lane(s[1], l), lane(s[2], l)])
        for r in ti.static(range(3)):
            value[r][l] = g[r]
            moment[3 * r][l] = g_i[r]
            moment[3 * r + 1][l] = g_j[r]
            moment[3 * r + 2][l] = g_k[r]
    by = summed(products)
    for r in ti.static(range(3)):
        B.v[r][q] = mass * value[r]
        through_p = Q[r] * value[0] + Q[3 + r] * value[1] + Q[6 + r] * value[2]
        B.x[r][q] = B.x[r][q] + (by[r] - through_p) / scene.cell
    Q_bar = [keep(scene.cell * (moment[i] - value[ti.static(i // 3)] * f[ti.static(i % 3)])) for i in range(9)]
    tau_bar = [keep(force * Q_bar[0]), keep(force * Q_bar[4]), keep(force * Q_bar[8]),
               keep(force * (Q_bar[1] + Q_bar[3])), keep(force * (Q_bar[2] + Q_bar[6])),
               keep(force * (Q_bar[5] + Q_bar[7]))]
    return tau_bar, [keep(mass * Q_bar[i]) for i in range(9)]


@ti.func
def summed(products: ti.template()):
    """Three packs of sums of four. They come through memory: sums over a vector's entries right after it was found make
    the compiler take the whole transfer apart into scalars (470 ns instead of 620 for a substep and grain)."""
    return [keep(ti.Vector([products[d, l][0] + products[d, l][1] + products[d, l][2] + products[d, l][3]
                            for l in range(4)])) for d in range(3)]

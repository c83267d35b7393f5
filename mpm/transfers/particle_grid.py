"""Transfers between particles and grid: quadratic B-splines, APIC and the MLS-MPM force.

A pack's particles are spread one lane at a time, with a node's momentum and mass as one 4-vector: q(node) =
q0 + a0 i + a1 j + a2 k over the 27 nodes, where the columns a are the affine momentum per cell.
"""

from mpm.backend import is_shared, ti
from mpm.materials.hencky_strain import keep


@ti.func
def weights(f):
    """Quadratic B-spline weights of the three nodes at offset f."""
    return [
        keep(0.5 * (1.5 - f) * (1.5 - f)),
        keep(0.75 - (f - 1.0) * (f - 1.0)),
        keep(0.5 * (f - 0.5) * (f - 0.5)),
    ]


@ti.func
def lane(packs: ti.template(), l):
    """One particle's three weights."""
    return [keep(packs[i][l]) for i in range(3)]


@ti.func
def scatter_lane(nodes: ti.template(), base: ti.template(), q0, a0, a1, a2,
                 wx: ti.template(), wy: ti.template(), wz: ti.template()):
    """Add one particle to its 27 nodes; on a CPU a plain load and store, because one thread owns the array."""
    q_i = q0
    for i in ti.static(range(3)):
        q_j = q_i
        for j in ti.static(range(3)):
            w = wx[i] * wy[j]
            q_k = q_j
            for k in ti.static(range(3)):
                I = (base[0] + i, base[1] + j, base[2] + k)
                if ti.static(is_shared()):
                    ti.atomic_add(nodes[I], q_k * (w * wz[k]))
                else:
                    nodes[I] = nodes[I] + q_k * (w * wz[k])
                q_k = q_k + a2
            q_j = q_j + a1
        q_i = q_i + a0


@ti.func
def gather_lane(nodes: ti.template(), base: ti.template(),
                wx: ti.template(), wy: ti.template(), wz: ti.template()):
    """Sum of w v and of w v i, w v j, w v k over the 27 nodes (velocity, and its moments in cells)."""
    value = ti.Vector.zero(nodes.dtype, 4)
    moment_i = value
    moment_j = value
    moment_k = value
    for i in ti.static(range(3)):
        plane = ti.Vector.zero(nodes.dtype, 4)
        plane_j = plane
        plane_k = plane
        for j in ti.static(range(3)):
            v0 = wz[0] * nodes[base[0] + i, base[1] + j, base[2]]
            v1 = wz[1] * nodes[base[0] + i, base[1] + j, base[2] + 1]
            v2 = wz[2] * nodes[base[0] + i, base[1] + j, base[2] + 2]
            row = wy[j] * (v0 + v1 + v2)
            plane = plane + row
            plane_j = plane_j + float(j) * row
            plane_k = plane_k + wy[j] * (v1 + 2.0 * v2)
        plane = wx[i] * plane
        value = value + plane
        moment_i = moment_i + float(i) * plane
        moment_j = moment_j + wx[i] * plane_j
        moment_k = moment_k + wx[i] * plane_k
    return value, moment_i, moment_j, moment_k

"""Quadratic B-splines, and the 27-node loops of every transfer between a particle and the grid.

One loop scatters, one gathers. A node's momentum and mass are one 4-vector. Over the nodes (i, j, k) of a stencil, 0
to 2 along each axis, what is scattered is affine: q(i, j, k) = q0 + a0 i + a1 j + a2 k. What is gathered is a sum over
the nodes with weights w_x(i) w_y(j) w_z(k), and three sums in which other weights replace those of one axis: for APIC's
moments the weights times i, j, k, for derivatives by the offsets the slopes of the weights.

What stands at a node is a static choice: `SingleLayer` and `ShellLayers` say which node a place in the stencil means,
`NodeValues` and `AffineProducts` which value is summed there."""

from typing import Any, NamedTuple

from mpm.backend import is_shared, once, ti


@ti.func
def weights(f):
    """Return the weights of the three nodes at offset f [cells] from the first, in [0.5, 1.5)."""
    return [once(0.5 * (1.5 - f) * (1.5 - f)), once(0.75 - (f - 1.0) * (f - 1.0)), once(0.5 * (f - 0.5) * (f - 0.5))]


@ti.func
def slopes(f):
    """Return the derivatives [1/cell] of the weights by the offset f."""
    return [once(f - 1.5), once(2.0 - 2.0 * f), once(f - 0.5)]


@ti.func
def lane_weights(packs: ti.template(), l):
    """Return the three weights of one particle of a pack."""
    return [once(packs[i][l]) for i in range(3)]


class SingleLayer(NamedTuple):
    """The nodes of the usual grid."""

    @ti.func
    def node(self, base: ti.template(), i: ti.template(), j: ti.template(), k: ti.template()):
        """Return the index of the node at place (i, j, k) of the stencil that begins at `base`."""
        return (base[0] + i, base[1] + j, base[2] + k)


class ShellLayers(NamedTuple):
    """Nodes of the first layer, or of the second where a shell separates them from a particle on a side of it."""

    grid: Any
    shells: Any
    side: Any
    """Label of the particle, see `shell_sides`."""
    shift: Any = 0
    """Nodes along x to the array that is meant, see `scatter_shift`."""

    @ti.func
    def node(self, base: ti.template(), i: ti.template(), j: ti.template(), k: ti.template()):
        """Return the index of the node at place (i, j, k) of the stencil that begins at `base`."""
        I = ti.Vector([base[0] + i, base[1] + j, base[2] + k])
        if self.shells.side[I] == -self.side:
            I[0] += self.grid.width
        I[0] += self.shift
        return I


class NodeValues(NamedTuple):
    """The values of a node field."""

    nodes: Any
    layers: Any

    @ti.func
    def at(self, base: ti.template(), i: ti.template(), j: ti.template(), k: ti.template()):
        """Return the value at place (i, j, k) of the stencil that begins at `base`."""
        return self.nodes[self.layers.node(base, i, j, k)]


class AffineProducts(NamedTuple):
    """Products, entry by entry, of a node field and an affine field q0 + a0 i + a1 j + a2 k."""

    nodes: Any
    layers: Any
    q0: Any
    a0: Any
    a1: Any
    a2: Any

    @ti.func
    def at(self, base: ti.template(), i: ti.template(), j: ti.template(), k: ti.template()):
        """Return the product at place (i, j, k) of the stencil that begins at `base`."""
        q = self.q0 + float(i) * self.a0 + float(j) * self.a1 + float(k) * self.a2
        return q * self.nodes[self.layers.node(base, i, j, k)]


@ti.func
def scatter_shift(fields: ti.template(), step: ti.template()):
    """Return the nodes along x from the beginning of the scatter target to the array of this part."""
    return step.part * ti.static(fields.grid.layers * fields.grid.width if fields.parts else 0)


@ti.func
def scatter(nodes: ti.template(), layers: ti.template(), base: ti.template(), q0, a0, a1, a2, w: ti.template()):
    """Add an affine field q0 + a0 i + a1 j + a2 k, times weights w (3 axes x 3), to the 27 nodes from `base` on.
    On a CPU it is a plain load and store, because one thread owns the nodes."""
    q_i = q0
    for i in ti.static(range(3)):
        q_j = q_i
        for j in ti.static(range(3)):
            w_ij = w[0][i] * w[1][j]
            q_k = q_j
            for k in ti.static(range(3)):
                I = layers.node(base, i, j, k)
                if ti.static(is_shared()):
                    ti.atomic_add(nodes[I], q_k * (w_ij * w[2][k]))
                else:
                    nodes[I] = nodes[I] + q_k * (w_ij * w[2][k])
                q_k = q_k + a2
            q_j = q_j + a1
        q_i = q_i + a0


@ti.func
def moments(w: ti.template()):
    """Return the weights of an axis times the node's place, 0 to 2: the other weights of APIC's moments."""
    return [w[0], w[1], once(2.0 * w[2])]


@ti.func
def gather(values: ti.template(), base: ti.template(), real: ti.template(), w: ti.template(), other: ti.template(),
           start: ti.template()):
    """Return the weighted sum (4,) of values over the 27 nodes from `base` on, and those with one axis's other weights.
    w, other: weights, 3 axes x 3. start: the first place at which the other weights are not zero."""
    total = ti.Vector.zero(real, 4)
    by_x = total
    by_y = total
    by_z = total
    for i in ti.static(range(3)):
        plane = ti.Vector.zero(real, 4)
        plane_y = plane
        plane_z = plane
        for j in ti.static(range(3)):
            v0, v1, v2 = values.at(base, i, j, 0), values.at(base, i, j, 1), values.at(base, i, j, 2)
            row = w[2][0] * v0 + w[2][1] * v1 + w[2][2] * v2
            plane = plane + w[1][j] * row
            if ti.static(j >= start):
                plane_y = plane_y + other[1][j] * row
            if ti.static(start == 0):
                plane_z = plane_z + w[1][j] * (other[2][0] * v0 + other[2][1] * v1 + other[2][2] * v2)
            else:
                plane_z = plane_z + w[1][j] * (other[2][1] * v1 + other[2][2] * v2)
        total = total + w[0][i] * plane
        if ti.static(i >= start):
            by_x = by_x + other[0][i] * plane
        by_y = by_y + w[0][i] * plane_y
        by_z = by_z + w[0][i] * plane_z
    return total, by_x, by_y, by_z

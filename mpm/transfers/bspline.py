"""Quadratic B-splines: weights of a stencil's three nodes along an axis, and their slopes."""

from mpm.backend import once, ti


@ti.func
def weights(f):
    """Return the weights of the three nodes at offset f [cells] from the first, in [0.5, 1.5)."""
    return [
        once(0.5 * (1.5 - f) * (1.5 - f)),
        once(0.75 - (f - 1.0) * (f - 1.0)),
        once(0.5 * (f - 0.5) * (f - 0.5)),
    ]


@ti.func
def slopes(f):
    """Return the derivatives [1/cell] of the weights by the offset f."""
    return [once(f - 1.5), once(2.0 - 2.0 * f), once(f - 0.5)]


@ti.func
def lane_weights(packs: ti.template(), l):
    """Return the three weights of one particle of a pack."""
    return [once(packs[i][l]) for i in range(3)]

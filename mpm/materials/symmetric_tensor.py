"""Symmetric tensors, element-wise: the same code runs on scalars and on packs of particles.
A symmetric tensor is a list of six entries [xx, yy, zz, xy, xz, yz]. The state of a solid is e = b - I, with b the
elastic left Cauchy-Green tensor: stored as a difference, a strain of 1e-6 keeps its digits in single precision."""

from mpm.backend import once, ti

FULL = (0, 3, 4, 3, 1, 5, 4, 5, 2)
"""Entry of a symmetric tensor's list for each of the nine places of the matrix, row by row."""
JACOBI_SWEEPS = 6
"""Cyclic Jacobi converges quadratically; six sweeps reach rounding in double precision for any 3x3 tensor."""


@ti.func
def product(a: ti.template(), b: ti.template()):
    """Return a b for symmetric tensors that commute, so that the product is symmetric too."""
    return [once(a[0] * b[0] + a[3] * b[3] + a[4] * b[4]), once(a[3] * b[3] + a[1] * b[1] + a[5] * b[5]),
            once(a[4] * b[4] + a[5] * b[5] + a[2] * b[2]), once(a[0] * b[3] + a[3] * b[1] + a[4] * b[5]),
            once(a[0] * b[4] + a[3] * b[5] + a[4] * b[2]), once(a[3] * b[4] + a[1] * b[5] + a[5] * b[2])]


@ti.func
def combine(alpha: ti.template(), diagonal: ti.template(), a: ti.template()):
    """Return diagonal * I + alpha * a."""
    return [once(diagonal + alpha * a[0]), once(diagonal + alpha * a[1]), once(diagonal + alpha * a[2]),
            once(alpha * a[3]), once(alpha * a[4]), once(alpha * a[5])]


@ti.func
def inverse(a: ti.template()):
    """Return the inverse of a symmetric tensor."""
    c0 = a[1] * a[2] - a[5] * a[5]
    c3 = a[4] * a[5] - a[3] * a[2]
    c4 = a[3] * a[5] - a[4] * a[1]
    s = 1.0 / (a[0] * c0 + a[3] * c3 + a[4] * c4)
    return [once(s * c0), once(s * (a[0] * a[2] - a[4] * a[4])), once(s * (a[0] * a[1] - a[3] * a[3])), once(s * c3),
            once(s * c4), once(s * (a[3] * a[4] - a[0] * a[5]))]


@ti.func
def determinant_minus_one(e: ti.template()):
    """Return det(I + e) - 1 without cancellation."""
    minors = e[0] * e[1] - e[3] * e[3] + e[0] * e[2] - e[4] * e[4] + e[1] * e[2] - e[5] * e[5]
    det = (e[0] * (e[1] * e[2] - e[5] * e[5]) - e[3] * (e[3] * e[2] - e[4] * e[5]) + e[4] * (e[3] * e[5] - e[4] * e[1]))
    return e[0] + e[1] + e[2] + minors + det


@ti.func
def newton_root(s: ti.template(), e: ti.template()):
    """Return s after one Newton step towards (I + s)^2 = I + e."""
    rest = product([once(e[i] - s[i]) for i in range(6)], inverse(combine(1.0, 1.0, s)))
    return [once(0.5 * (s[i] + rest[i])) for i in range(6)]


@ti.func
def square_root(e: ti.template()):
    """Return (I + e)^(1/2) - I by five Newton steps: exact to rounding for stretches between 0.3 and 3."""
    first = newton_root(combine(0.5, 0.0, e), e)
    second = newton_root(first, e)
    third = newton_root(second, e)
    return newton_root(newton_root(third, e), e)


@ti.func
def rotate(diagonal_p: ti.template(), diagonal_q: ti.template(), off: ti.template()):
    """Return the Jacobi rotation (cosine, sine, tangent) that annihilates `off`; the identity where it is zero."""
    d = diagonal_q - diagonal_p
    side = ti.select(d >= 0, 1.0, -1.0)
    t = 2.0 * off * side / (ti.abs(d) + ti.sqrt(d * d + 4.0 * off * off) + 1e-37)
    t = ti.max(ti.min(t, 1.0), -1.0)  # beyond, the squares of what is left fell below the smallest number
    c = 1.0 / ti.sqrt(1.0 + t * t)
    return c, t * c, t


@ti.func
def spectrum(a: ti.template(), sweeps: ti.template()):
    """Return eigenvalues [3] and eigenvectors (columns of row-major [9]) by cyclic Jacobi rotations."""
    one = 0.0 * a[0] + 1.0
    d = [a[0] + 0.0, a[1] + 0.0, a[2] + 0.0]
    o = [a[3] + 0.0, a[4] + 0.0, a[5] + 0.0]
    v = [one, 0.0 * one, 0.0 * one, 0.0 * one, one + 0.0, 0.0 * one, 0.0 * one, 0.0 * one, one + 0.0]
    for _ in range(sweeps):
        for p, q, pq, pr, qr in ti.static(((0, 1, 0, 1, 2), (0, 2, 1, 0, 2), (1, 2, 2, 0, 1))):
            # pr and qr are the off-diagonals that p and q share with the third axis
            c, s, t = rotate(d[p], d[q], o[pq])
            d[p] -= t * o[pq]
            d[q] += t * o[pq]
            o[pq] *= 0.0
            shared = c * o[pr] - s * o[qr]
            o[qr] = s * o[pr] + c * o[qr]
            o[pr] = shared
            for row in ti.static(range(3)):
                turned = c * v[3 * row + p] - s * v[3 * row + q]
                v[3 * row + q] = s * v[3 * row + p] + c * v[3 * row + q]
                v[3 * row + p] = turned
    return d, v


@ti.func
def compose(d: ti.template(), v: ti.template()):
    """Return sum_k d_k v_k v_k^T."""
    return [once(d[0] * v[0] * v[0] + d[1] * v[1] * v[1] + d[2] * v[2] * v[2]),
            once(d[0] * v[3] * v[3] + d[1] * v[4] * v[4] + d[2] * v[5] * v[5]),
            once(d[0] * v[6] * v[6] + d[1] * v[7] * v[7] + d[2] * v[8] * v[8]),
            once(d[0] * v[0] * v[3] + d[1] * v[1] * v[4] + d[2] * v[2] * v[5]),
            once(d[0] * v[0] * v[6] + d[1] * v[1] * v[7] + d[2] * v[2] * v[8]),
            once(d[0] * v[3] * v[6] + d[1] * v[4] * v[7] + d[2] * v[5] * v[8])]

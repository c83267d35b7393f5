"""Hencky strain of symmetric tensors, element-wise: the same code runs on scalars and on packs of particles.

A symmetric tensor is a list of six entries [xx, yy, zz, xy, xz, yz]. The state is e = b - I with b the elastic left
Cauchy-Green tensor: stored as a difference, a strain of 1e-6 keeps its digits in single precision.
"""

from mpm.backend import ti

FULL = (0, 3, 4, 3, 1, 5, 4, 5, 2)
"""Entry of a symmetric tensor's list for each of the nine places of the matrix, row by row."""
JACOBI_SWEEPS = 6
"""Cyclic Jacobi converges quadratically; six sweeps reach rounding in double precision for any 3x3 tensor."""


@ti.func
def keep(value):
    """The value as a variable: an expression in a list would be computed anew at each use."""
    kept = value
    return kept


@ti.func
def product(a: ti.template(), b: ti.template()):
    """a b for symmetric tensors that commute, so that the product is symmetric too."""
    return [
        keep(a[0] * b[0] + a[3] * b[3] + a[4] * b[4]),
        keep(a[3] * b[3] + a[1] * b[1] + a[5] * b[5]),
        keep(a[4] * b[4] + a[5] * b[5] + a[2] * b[2]),
        keep(a[0] * b[3] + a[3] * b[1] + a[4] * b[5]),
        keep(a[0] * b[4] + a[3] * b[5] + a[4] * b[2]),
        keep(a[3] * b[4] + a[1] * b[5] + a[5] * b[2]),
    ]


@ti.func
def combine(alpha: ti.template(), diagonal: ti.template(), a: ti.template()):
    """diagonal * I + alpha * a."""
    return [
        keep(diagonal + alpha * a[0]),
        keep(diagonal + alpha * a[1]),
        keep(diagonal + alpha * a[2]),
        keep(alpha * a[3]),
        keep(alpha * a[4]),
        keep(alpha * a[5]),
    ]


@ti.func
def inverse(a: ti.template()):
    c0 = a[1] * a[2] - a[5] * a[5]
    c3 = a[4] * a[5] - a[3] * a[2]
    c4 = a[3] * a[5] - a[4] * a[1]
    s = 1.0 / (a[0] * c0 + a[3] * c3 + a[4] * c4)
    return [
        keep(s * c0),
        keep(s * (a[0] * a[2] - a[4] * a[4])),
        keep(s * (a[0] * a[1] - a[3] * a[3])),
        keep(s * c3),
        keep(s * c4),
        keep(s * (a[3] * a[4] - a[0] * a[5])),
    ]


@ti.func
def determinant_minus_one(e: ti.template()):
    """det(I + e) - 1 without the cancellation."""
    minors = e[0] * e[1] - e[3] * e[3] + e[0] * e[2] - e[4] * e[4] + e[1] * e[2] - e[5] * e[5]
    det = (e[0] * (e[1] * e[2] - e[5] * e[5]) - e[3] * (e[3] * e[2] - e[4] * e[5])
           + e[4] * (e[3] * e[5] - e[4] * e[1]))
    return e[0] + e[1] + e[2] + minors + det


@ti.func
def newton_root(s: ti.template(), e: ti.template()):
    """One Newton step towards (I + s)^2 = I + e."""
    rest = product([keep(e[i] - s[i]) for i in range(6)], inverse(combine(1.0, 1.0, s)))
    return [keep(0.5 * (s[i] + rest[i])) for i in range(6)]


@ti.func
def square_root(e: ti.template()):
    """(I + e)^(1/2) - I by five Newton steps: exact to rounding for stretches between 0.3 and 3."""
    first = newton_root(combine(0.5, 0.0, e), e)
    second = newton_root(first, e)
    third = newton_root(second, e)
    return newton_root(newton_root(third, e), e)


@ti.func
def advance_e(e: ti.template(), a: ti.template()):
    """e of (I + a) b (I + a)^T, with a = dt C given row by row (nine entries)."""
    # rows of (I + a) e + a: the asymmetric half of the product
    p00 = e[0] + a[0] * e[0] + a[1] * e[3] + a[2] * e[4] + a[0]
    p01 = e[3] + a[0] * e[3] + a[1] * e[1] + a[2] * e[5] + a[1]
    p02 = e[4] + a[0] * e[4] + a[1] * e[5] + a[2] * e[2] + a[2]
    p10 = e[3] + a[3] * e[0] + a[4] * e[3] + a[5] * e[4] + a[3]
    p11 = e[1] + a[3] * e[3] + a[4] * e[1] + a[5] * e[5] + a[4]
    p12 = e[5] + a[3] * e[4] + a[4] * e[5] + a[5] * e[2] + a[5]
    p20 = e[4] + a[6] * e[0] + a[7] * e[3] + a[8] * e[4] + a[6]
    p21 = e[5] + a[6] * e[3] + a[7] * e[1] + a[8] * e[5] + a[7]
    p22 = e[2] + a[6] * e[4] + a[7] * e[5] + a[8] * e[2] + a[8]
    # e' = p (I + a)^T + a^T
    return [
        keep(p00 + p00 * a[0] + p01 * a[1] + p02 * a[2] + a[0]),
        keep(p11 + p10 * a[3] + p11 * a[4] + p12 * a[5] + a[4]),
        keep(p22 + p20 * a[6] + p21 * a[7] + p22 * a[8] + a[8]),
        keep(p01 + p00 * a[3] + p01 * a[4] + p02 * a[5] + a[3]),
        keep(p02 + p00 * a[6] + p01 * a[7] + p02 * a[8] + a[6]),
        keep(p12 + p10 * a[6] + p11 * a[7] + p12 * a[8] + a[7]),
    ]


@ti.func
def hencky_series(e: ti.template()):
    """h = log(I + e) / 2 = Y + Y^3/3 + Y^5/5 + Y^7/7, Y = e (2 I + e)^-1; relative error below 3e-7 for |h| < 0.2."""
    y = product(e, inverse(combine(1.0, 2.0, e)))
    z = product(y, y)
    fifth = combine(1.0 / 7.0, 1.0 / 5.0, z)
    third = combine(1.0, 1.0 / 3.0, product(z, fifth))
    return product(y, combine(1.0, 1.0, product(z, third)))


@ti.func
def exponential_series(h: ti.template()):
    """e = exp(2 h) - I by the [3/3] Pade form, (A - B)^-1 2 B with A = I + x^2/10, B = x/2 + x^3/120, x = 2 h."""
    x = combine(2.0, 0.0, h)
    z = product(x, x)
    odd = product(x, combine(1.0 / 120.0, 0.5, z))
    even = combine(0.1, 1.0, z)
    difference = [even[0] - odd[0], even[1] - odd[1], even[2] - odd[2],
                  even[3] - odd[3], even[4] - odd[4], even[5] - odd[5]]
    return product(inverse(difference), combine(2.0, 0.0, odd))


@ti.func
def rotate(diagonal_p: ti.template(), diagonal_q: ti.template(), off: ti.template()):
    """Jacobi rotation (cosine, sine, tangent) that annihilates `off`; the identity where `off` is zero."""
    d = diagonal_q - diagonal_p
    side = ti.select(d >= 0, 1.0, -1.0)
    t = 2.0 * off * side / (ti.abs(d) + ti.sqrt(d * d + 4.0 * off * off) + 1e-37)
    t = ti.max(ti.min(t, 1.0), -1.0)  # beyond, the squares of what is left fell below the smallest number
    c = 1.0 / ti.sqrt(1.0 + t * t)
    return c, t * c, t


@ti.func
def spectrum(a: ti.template(), sweeps: ti.template()):
    """Eigenvalues [3] and eigenvectors (row-major [9], in columns) of a symmetric tensor by cyclic Jacobi rotations."""
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
    """sum_k d_k v_k v_k^T."""
    return [
        keep(d[0] * v[0] * v[0] + d[1] * v[1] * v[1] + d[2] * v[2] * v[2]),
        keep(d[0] * v[3] * v[3] + d[1] * v[4] * v[4] + d[2] * v[5] * v[5]),
        keep(d[0] * v[6] * v[6] + d[1] * v[7] * v[7] + d[2] * v[8] * v[8]),
        keep(d[0] * v[0] * v[3] + d[1] * v[1] * v[4] + d[2] * v[2] * v[5]),
        keep(d[0] * v[0] * v[6] + d[1] * v[1] * v[7] + d[2] * v[2] * v[8]),
        keep(d[0] * v[3] * v[6] + d[1] * v[4] * v[7] + d[2] * v[5] * v[8]),
    ]


@ti.func
def log1p(x):
    """log(1 + x) with the digits of a small x: 2 atanh(x / (2 + x)), up to its 13th power where that holds."""
    y = x / (2.0 + x)
    z = y * y
    series = 2.0 * y * (1.0 + z * (1 / 3 + z * (1 / 5 + z * (1 / 7 + z * (1 / 9 + z * (1 / 11 + z / 13))))))
    return ti.select(ti.abs(y) < 0.1, series, ti.log(1.0 + x))


@ti.func
def expm1(x):
    """exp(x) - 1 with the digits of a small x: Taylor's series up to the 11th power where that holds."""
    high = 1 / 5040 + x * (1 / 40320 + x * (1 / 362880 + x * (1 / 3628800 + x / 39916800)))
    series = x * (1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x * high))))))
    return ti.select(ti.abs(x) < 0.2, series, ti.exp(x) - 1.0)


@ti.func
def hencky_exact(e: ti.template()):
    """h = log(I + e) / 2 through the eigenvalues of e."""
    d, v = spectrum(e, JACOBI_SWEEPS)
    return compose([keep(0.5 * log1p(d[i])) for i in range(3)], v)


@ti.func
def exponential_exact(h: ti.template()):
    """e = exp(2 h) - I through the eigenvalues of h."""
    d, v = spectrum(h, JACOBI_SWEEPS)
    return compose([keep(expm1(2.0 * d[i])) for i in range(3)], v)


SERIES_LIMIT = 0.26
"""Largest entry of e, or of 2 h, up to which the series are exact to single precision: |h| = 0.15 in compression."""


@ti.func
def largest(a: ti.template()):
    """Largest entry of the four tensors of a pack."""
    diagonal = ti.max(ti.abs(a[0]), ti.abs(a[1]), ti.abs(a[2]))
    return ti.max(diagonal, ti.abs(a[3]), ti.abs(a[4]), ti.abs(a[5])).max()


@ti.func
def hencky_auto(e: ti.template()):
    """The series, or for a pack that holds a large strain the eigenvalues."""
    h = hencky_series(e)
    if largest(e) > SERIES_LIMIT:
        exact = hencky_exact(e)
        for i in ti.static(range(6)):
            h[i] = exact[i]
    return h


@ti.func
def exponential_auto(h: ti.template()):
    """The series, or for a pack that holds a large strain the eigenvalues."""
    e = exponential_series(h)
    if 2.0 * largest(h) > SERIES_LIMIT:
        exact = exponential_exact(h)
        for i in ti.static(range(6)):
            e[i] = exact[i]
    return e


INTEGRATORS = {
    "series": (hencky_series, exponential_series),
    "exact": (hencky_exact, exponential_exact),
    "auto": (hencky_auto, exponential_auto),
}
"""Name -> (logarithm, exponential)."""

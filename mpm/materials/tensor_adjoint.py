"""Adjoints of the functions of symmetric tensors.
`x_bar` is the adjoint of x: the derivative of the loss with respect to x. A symmetric tensor is a list of six entries,
and its adjoint is the list of derivatives with respect to these. An off-diagonal entry stands for two places of the
matrix, so that the matrix of derivatives holds half of it in each. Functions of tensors are differentiated through
eigenvalues (Daleckii and Krein 1965), which is exact where eigenvalues coincide, too."""

from mpm.backend import once, ti
from mpm.materials.hencky_strain import expm1, log1p
from mpm.materials.symmetric_tensor import FULL


@ti.func
def matrix_of_bar(bar: ti.template()):
    """Return the symmetric matrix of derivatives, nine entries row by row, for an adjoint of six entries."""
    x, y, z = 0.5 * bar[3], 0.5 * bar[4], 0.5 * bar[5]
    return [once(bar[0]), x, y, x, once(bar[1]), z, y, z, once(bar[2])]


@ti.func
def bar_of_matrix(m: ti.template()):
    """Return the adjoint of six entries for a matrix of derivatives, nine entries row by row."""
    return [once(m[0]), once(m[4]), once(m[8]), once(m[1] + m[3]), once(m[2] + m[6]), once(m[5] + m[7])]


@ti.func
def multiply(a: ti.template(), b: ti.template()):
    """Return a b of matrices with nine entries, row by row."""
    return [once(a[3 * (i // 3)] * b[i % 3] + a[3 * (i // 3) + 1] * b[3 + i % 3] + a[3 * (i // 3) + 2] * b[6 + i % 3])
            for i in range(9)]


@ti.func
def transpose(a: ti.template()):
    """Return a^T of a matrix with nine entries, row by row."""
    return [a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]]


@ti.func
def through_spectrum(v: ti.template(), k: ti.template(), bar: ti.template()):
    """Return the adjoint of the argument of an isotropic tensor function.
    k: divided differences [00, 11, 22, 01, 02, 12] of the function of eigenvalues. v: eigenvectors. bar: the adjoint of
    the function's value."""
    n = multiply(transpose(v), multiply(matrix_of_bar(bar), v))
    return bar_of_matrix(multiply(v, multiply([once(n[i] * k[FULL[i]]) for i in range(9)], transpose(v))))


@ti.func
def log_quotient(d, f):
    """Return (log(1 + d) - log(1 + f)) / (d - f), also where they coincide."""
    t = (d - f) / (1.0 + f)
    tiny = ti.abs(t) < 1e-20
    return ti.select(tiny, 1.0, log1p(t) / ti.select(tiny, 1.0, t)) / (1.0 + f)


@ti.func
def exp_quotient(d, f):
    """Return (exp(d) - exp(f)) / (d - f), also where they coincide."""
    s = d - f
    tiny = ti.abs(s) < 1e-20
    return (1.0 + expm1(f)) * ti.select(tiny, 1.0, expm1(s) / ti.select(tiny, 1.0, s))


SVD_CLAMP = 1e-6
"""Smallest difference of squared singular values that autodiff through an SVD divides by, as in PlasticineLab (Huang et
al. 2021)."""


@ti.func
def log_divided(d, f, svd: ti.template()):
    """Return the divided difference of log(1 + d).
    With svd it is that of the decomposition's two factors, one product from each: their rounding is divided by the
    difference, and coinciding values have no derivative."""
    if ti.static(svd):
        far = ti.max(ti.abs(d - f), SVD_CLAMP)
        inverse = ti.select(d < f, -1.0 / far, 1.0 / far)
        return log1p(d) * inverse - log1p(f) * inverse
    else:
        return log_quotient(d, f)


@ti.func
def logarithm_back(d: ti.template(), v: ti.template(), bar: ti.template(), svd: ti.template()):
    """Return the adjoint of e from that of h = log(I + e) / 2, with the eigenvalues d and eigenvectors v of e."""
    k = [once(0.5 / (1.0 + d[0])), once(0.5 / (1.0 + d[1])), once(0.5 / (1.0 + d[2])),
         once(0.5 * log_divided(d[0], d[1], svd)), once(0.5 * log_divided(d[0], d[2], svd)),
         once(0.5 * log_divided(d[1], d[2], svd))]
    return through_spectrum(v, k, bar)


@ti.func
def exponential_back(h: ti.template(), v: ti.template(), bar: ti.template()):
    """Return the adjoint of h from that of e = exp(2 h) - I, with eigenvectors v of h."""
    d = [once(2.0 * (v[i] * (h[0] * v[i] + 2.0 * h[3] * v[3 + i] + 2.0 * h[4] * v[6 + i])
                     + v[3 + i] * (h[1] * v[3 + i] + 2.0 * h[5] * v[6 + i]) + h[2] * v[6 + i] * v[6 + i]))
         for i in range(3)]
    k = [once(2.0 + 2.0 * expm1(d[0])), once(2.0 + 2.0 * expm1(d[1])), once(2.0 + 2.0 * expm1(d[2])),
         once(2.0 * exp_quotient(d[0], d[1])), once(2.0 * exp_quotient(d[0], d[2])),
         once(2.0 * exp_quotient(d[1], d[2]))]
    return through_spectrum(v, k, bar)


@ti.func
def root_back(d: ti.template(), v: ti.template(), bar: ti.template()):
    """Return the adjoint of e from that of s = (I + e)^(1/2) - I, with the eigenvalues d and eigenvectors v of e."""
    r = [once(ti.sqrt(1.0 + d[i])) for i in range(3)]
    k = [once(0.5 / r[0]), once(0.5 / r[1]), once(0.5 / r[2]), once(1.0 / (r[0] + r[1])), once(1.0 / (r[0] + r[2])),
         once(1.0 / (r[1] + r[2]))]
    return through_spectrum(v, k, bar)

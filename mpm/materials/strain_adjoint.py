"""Adjoints of the strain functions of `mpm.materials.hencky_strain`.

A symmetric tensor is a list of six entries, and its bar the list of derivatives by these: an off-diagonal entry stands
for two places of the matrix, so that the matrix of derivatives holds half of it in each. Functions of tensors are
differentiated through eigenvalues (Daleckii and Krein 1965), which is exact where eigenvalues coincide, too.
"""

from mpm.backend import ti
from mpm.materials.hencky_strain import FULL, expm1, keep, log1p


@ti.func
def matrix_of_bar(bar: ti.template()):
    """Nine places of the symmetric matrix of derivatives, row by row."""
    x, y, z = 0.5 * bar[3], 0.5 * bar[4], 0.5 * bar[5]
    return [keep(bar[0]), x, y, x, keep(bar[1]), z, y, z, keep(bar[2])]


@ti.func
def bar_of_matrix(m: ti.template()):
    """The list of derivatives that nine places of a matrix, row by row, stand for."""
    return [keep(m[0]), keep(m[4]), keep(m[8]), keep(m[1] + m[3]), keep(m[2] + m[6]), keep(m[5] + m[7])]


@ti.func
def multiply(a: ti.template(), b: ti.template()):
    """a b of matrices with nine entries, row by row."""
    return [keep(a[3 * (i // 3)] * b[i % 3] + a[3 * (i // 3) + 1] * b[3 + i % 3] + a[3 * (i // 3) + 2] * b[6 + i % 3])
            for i in range(9)]


@ti.func
def transposed(a: ti.template()):
    """a^T."""
    return [a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]]


@ti.func
def advance_back(e: ti.template(), a: ti.template(), bar: ti.template()):
    """(e_bar, a_bar) of `advance_e`: with F = I + a and M the bar's matrix, F^T M F and 2 M F (I + e)."""
    F = [keep(a[i] + (1.0 if ti.static(i % 4 == 0) else 0.0)) for i in range(9)]
    b = [keep(e[FULL[i]] + (1.0 if ti.static(i % 4 == 0) else 0.0)) for i in range(9)]
    MF = multiply(matrix_of_bar(bar), F)
    MFb = multiply(MF, b)
    return bar_of_matrix(multiply(transposed(F), MF)), [keep(2.0 * MFb[i]) for i in range(9)]


@ti.func
def through_spectrum(v: ti.template(), k: ti.template(), bar: ti.template()):
    """Bar of a tensor's argument: divided differences k [00, 11, 22, 01, 02, 12] of a function of eigenvalues."""
    n = multiply(transposed(v), multiply(matrix_of_bar(bar), v))
    return bar_of_matrix(multiply(v, multiply([keep(n[i] * k[FULL[i]]) for i in range(9)], transposed(v))))


@ti.func
def log_quotient(d, f):
    """(log(1 + d) - log(1 + f)) / (d - f), also where they coincide."""
    t = (d - f) / (1.0 + f)
    tiny = ti.abs(t) < 1e-20
    return ti.select(tiny, 1.0, log1p(t) / ti.select(tiny, 1.0, t)) / (1.0 + f)


@ti.func
def exp_quotient(d, f):
    """(exp(d) - exp(f)) / (d - f), also where they coincide."""
    s = d - f
    tiny = ti.abs(s) < 1e-20
    return (1.0 + expm1(f)) * ti.select(tiny, 1.0, expm1(s) / ti.select(tiny, 1.0, s))


SVD_CLAMP = 1e-6
"""Smallest difference of squared singular values that autodiff through an SVD divides by, as in PlasticineLab (Huang et
al. 2021)."""


@ti.func
def log_divided(d, f, svd: ti.template()):
    """The divided difference of log(1 + d). With svd as it comes out of the decomposition's two factors, one product
    from each: their rounding is divided by the difference, and what coincides has no derivative."""
    if ti.static(svd):
        far = ti.max(ti.abs(d - f), SVD_CLAMP)
        inverse = ti.select(d < f, -1.0 / far, 1.0 / far)
        return log1p(d) * inverse - log1p(f) * inverse
    else:
        return log_quotient(d, f)


@ti.func
def logarithm_back(d: ti.template(), v: ti.template(), bar: ti.template(), svd: ti.template()):
    """Bar of e by that of h = log(I + e) / 2, with the eigenvalues d and eigenvectors v of e."""
    k = [keep(0.5 / (1.0 + d[0])), keep(0.5 / (1.0 + d[1])), keep(0.5 / (1.0 + d[2])),
         keep(0.5 * log_divided(d[0], d[1], svd)), keep(0.5 * log_divided(d[0], d[2], svd)),
         keep(0.5 * log_divided(d[1], d[2], svd))]
    return through_spectrum(v, k, bar)


@ti.func
def exponential_back(h: ti.template(), v: ti.template(), bar: ti.template()):
    """Bar of h by that of e = exp(2 h) - I, with eigenvectors v of h."""
    d = [keep(2.0 * (v[i] * (h[0] * v[i] + 2.0 * h[3] * v[3 + i] + 2.0 * h[4] * v[6 + i])
                     + v[3 + i] * (h[1] * v[3 + i] + 2.0 * h[5] * v[6 + i]) + h[2] * v[6 + i] * v[6 + i]))
         for i in range(3)]
    k = [keep(2.0 + 2.0 * expm1(d[0])), keep(2.0 + 2.0 * expm1(d[1])), keep(2.0 + 2.0 * expm1(d[2])),
         keep(2.0 * exp_quotient(d[0], d[1])), keep(2.0 * exp_quotient(d[0], d[2])),
         keep(2.0 * exp_quotient(d[1], d[2]))]
    return through_spectrum(v, k, bar)


@ti.func
def root_back(d: ti.template(), v: ti.template(), bar: ti.template()):
    """Bar of e by that of s = (I + e)^(1/2) - I, with the eigenvalues d and eigenvectors v of e."""
    r = [keep(ti.sqrt(1.0 + d[i])) for i in range(3)]
    k = [keep(0.5 / r[0]), keep(0.5 / r[1]), keep(0.5 / r[2]), keep(1.0 / (r[0] + r[1])), keep(1.0 / (r[0] + r[2])),
         keep(1.0 / (r[1] + r[2]))]
    return through_spectrum(v, k, bar)

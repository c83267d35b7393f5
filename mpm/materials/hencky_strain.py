"""Hencky strain h = log(b) / 2 of e = b - I and its inverse, by series or through eigenvalues."""

from mpm.backend import once, ti
from mpm.materials.symmetric_tensor import JACOBI_SWEEPS, combine, compose, inverse, product, spectrum


@ti.func
def log1p(x):
    """Return log(1 + x) with the digits of a small x: 2 atanh(x / (2 + x)), up to its 13th power."""
    y = x / (2.0 + x)
    z = y * y
    series = 2.0 * y * (1.0 + z * (1 / 3 + z * (1 / 5 + z * (1 / 7 + z * (1 / 9 + z * (1 / 11 + z / 13))))))
    return ti.select(ti.abs(y) < 0.1, series, ti.log(1.0 + x))


@ti.func
def expm1(x):
    """Return exp(x) - 1 with the digits of a small x: Taylor's series up to the 11th power."""
    high = 1 / 5040 + x * (1 / 40320 + x * (1 / 362880 + x * (1 / 3628800 + x / 39916800)))
    series = x * (1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x * high))))))
    return ti.select(ti.abs(x) < 0.2, series, ti.exp(x) - 1.0)


@ti.func
def hencky_series(e: ti.template()):
    """Return h = log(I + e) / 2 by a series.
    Y + Y^3/3 + Y^5/5 + Y^7/7 with Y = e (2 I + e)^-1: relative error below 3e-7 for |h| < 0.2."""
    y = product(e, inverse(combine(1.0, 2.0, e)))
    z = product(y, y)
    fifth = combine(1.0 / 7.0, 1.0 / 5.0, z)
    third = combine(1.0, 1.0 / 3.0, product(z, fifth))
    return product(y, combine(1.0, 1.0, product(z, third)))


@ti.func
def exponential_series(h: ti.template()):
    """Return e = exp(2 h) - I by the [3/3] Pade form.
    (A - B)^-1 2 B with A = I + x^2/10, B = x/2 + x^3/120, x = 2 h."""
    x = combine(2.0, 0.0, h)
    z = product(x, x)
    odd = product(x, combine(1.0 / 120.0, 0.5, z))
    even = combine(0.1, 1.0, z)
    difference = [even[0] - odd[0], even[1] - odd[1], even[2] - odd[2],
                  even[3] - odd[3], even[4] - odd[4], even[5] - odd[5]]
    return product(inverse(difference), combine(2.0, 0.0, odd))


@ti.func
def hencky_exact(e: ti.template()):
    """Return h = log(I + e) / 2 through the eigenvalues of e."""
    d, v = spectrum(e, JACOBI_SWEEPS)
    return compose([once(0.5 * log1p(d[i])) for i in range(3)], v)


@ti.func
def exponential_exact(h: ti.template()):
    """Return e = exp(2 h) - I through the eigenvalues of h."""
    d, v = spectrum(h, JACOBI_SWEEPS)
    return compose([once(expm1(2.0 * d[i])) for i in range(3)], v)


SERIES_LIMIT = 0.26
"""Largest entry of e, or of 2 h, up to which the series are exact to single precision: |h| = 0.15 in compression."""


@ti.func
def largest(a: ti.template()):
    """Return the largest entry of the tensors of a pack."""
    diagonal = ti.max(ti.abs(a[0]), ti.abs(a[1]), ti.abs(a[2]))
    return ti.max(diagonal, ti.abs(a[3]), ti.abs(a[4]), ti.abs(a[5])).max()


@ti.func
def hencky_auto(e: ti.template()):
    """Evaluate the series, or for a pack with a large strain the eigenvalues."""
    h = hencky_series(e)
    if largest(e) > SERIES_LIMIT:
        exact = hencky_exact(e)
        for i in ti.static(range(6)):
            h[i] = exact[i]
    return h


@ti.func
def exponential_auto(h: ti.template()):
    """Evaluate the series, or for a pack with a large strain the eigenvalues."""
    e = exponential_series(h)
    if 2.0 * largest(h) > SERIES_LIMIT:
        exact = exponential_exact(h)
        for i in ti.static(range(6)):
            e[i] = exact[i]
    return e


INTEGRATORS = {"series": (hencky_series, exponential_series), "exact": (hencky_exact, exponential_exact),
               "auto": (hencky_auto, exponential_auto)}
"""Name -> (logarithm, exponential)."""

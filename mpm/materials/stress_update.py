"""The constitutive update: the state of a pack of particles advanced by a substep, and its stress."""

from mpm.backend import once, ti
from mpm.materials.density import numbers_of

LEAST_RATIO = 2.0**-20
"""Smallest volume ratio J of a fluid: below it, J - 1 has no digits in single precision."""


@ti.func
def advance_cauchy_green(e: ti.template(), a: ti.template()):
    """Return e of (I + a) b (I + a)^T, with a = dt C given row by row (nine entries)."""
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
    return [once(p00 + p00 * a[0] + p01 * a[1] + p02 * a[2] + a[0]),
            once(p11 + p10 * a[3] + p11 * a[4] + p12 * a[5] + a[4]),
            once(p22 + p20 * a[6] + p21 * a[7] + p22 * a[8] + a[8]),
            once(p01 + p00 * a[3] + p01 * a[4] + p02 * a[5] + a[3]),
            once(p02 + p00 * a[6] + p01 * a[7] + p02 * a[8] + a[6]),
            once(p12 + p10 * a[6] + p11 * a[7] + p12 * a[8] + a[7])]


@ti.func
def volume_growth(d):
    """Return g - 1, with g = d + sqrt(1 + d^2) the factor of J in a substep with d = dt tr(C).
    g is exp(d) up to d^3 / 6, is positive for any d, and g(-d) = 1 / g(d): the opposite rate leads back."""
    size = ti.abs(d)
    rise = size + size * size / (1.0 + ti.sqrt(1.0 + size * size))
    return ti.select(d < 0.0, -rise / (1.0 + rise), rise)


@ti.func
def advance_volume(j, d):
    """Return j = J - 1 after a substep with d = dt tr(C)."""
    return ti.max(j + (1.0 + j) * volume_growth(d), LEAST_RATIO - 1.0)


@ti.func
def update_stress(fields: ti.template(), P: ti.template(), law: ti.template(), q, dt, C: ti.template(),
                  p: ti.template()):
    """Advance the state of pack q by dt [s] with the velocity gradient C; return its Kirchhoff stress [Pa].
    dt may be 0 where there are strides."""
    if ti.static(law.state == "volume"):
        P.j[q] = advance_volume(P.j[q], dt * (C[0] + C[4] + C[8]))
        return law.stress(once(P.j[q]), C, p)
    elif ti.static(law.state == "cauchy_green"):
        e = advance_elastically(P, q, dt, C)
        for i in ti.static(range(6)):
            P.e[i][q] = e[i]
        return law.stress(e, p)
    elif ti.static(not law.plastic):
        e = advance_elastically(P, q, dt, C)
        for i in ti.static(range(6)):
            P.e[i][q] = e[i]
        return law.stress(fields.logarithm(e), p)
    else:
        return update_plastic_stress(fields, P, law, q, dt, C, p)


@ti.func
def advance_elastically(P: ti.template(), q, dt, C: ti.template()):
    """Return e of pack q as if the substep were elastic: the trial state."""
    return advance_cauchy_green([once(P.e[i][q]) for i in range(6)], [once(dt * C[i]) for i in range(9)])


@ti.func
def update_plastic_stress(fields: ti.template(), P: ti.template(), law: ti.template(), q, dt, C: ti.template(),
                          p: ti.template()):
    """Apply the return mapping to the trial Hencky strain, store the new e; return the Kirchhoff stress [Pa]."""
    trial = fields.logarithm(advance_elastically(P, q, dt, C))
    if ti.static(fields.features.strides):
        h = [once(trial[i]) for i in range(6)]
        if dt > 0:
            mapped = map_and_store(fields, P, law, q, dt, trial, p)
            for i in ti.static(range(6)):
                h[i] = mapped[i]
        return law.stress(h, p)
    else:
        return law.stress(map_and_store(fields, P, law, q, dt, trial, p), p)


@ti.func
def map_and_store(fields: ti.template(), P: ti.template(), law: ti.template(), q, dt, trial: ti.template(),
                  p: ti.template()):
    """Return the Hencky strain (six) after the return mapping of a trial strain; store its e."""
    remembered = trial[0] * 0.0
    if ti.static(law.has_volume_correction):
        remembered = P.vc[q]
    h, expansion = law.return_mapping(trial, remembered, p, dt)
    if ti.static(law.has_volume_correction):
        P.vc[q] = expansion
    back = fields.exponential(h)
    for i in ti.static(range(6)):
        P.e[i][q] = back[i]
    return h


@ti.func
def current_stress(fields: ti.template(), P: ti.template(), law: ti.template(), q, body, p: ti.template()):
    """Return the Kirchhoff stress [Pa] of pack q of a body as it is: what `update_stress` gives for no time, nothing
    stored."""
    C = [once(P.C[i][q]) for i in range(9)]
    numbers = numbers_of(fields, P, law, q, fields.parameters.densities[body], p)
    if ti.static(law.state == "volume"):
        return law.stress(once(P.j[q]), C, numbers)
    elif ti.static(law.state == "cauchy_green"):
        return law.stress([once(P.e[i][q]) for i in range(6)], numbers)
    else:
        return law.stress(fields.logarithm([once(P.e[i][q]) for i in range(6)]), numbers)

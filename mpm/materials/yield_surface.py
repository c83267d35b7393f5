"""Yield surfaces: the condition that return mappings share, and the cone of Drucker and Prager, of Hencky strain.

A deviator whose norm N exceeds what the cone allows, a, flows: its norm comes back to a. Where friction grows with the
rate of shear, by the mu(I) law of Jop et al. (2006), the norm n that stays is, with x = N - n the plastic strain of the
substep and a what the cone allows at rest,

    n = a + (R - 1) s x / (x + c),    c = dt kappa sqrt(-trace),

where s is the part of a that friction has, without cohesion, R its value at infinite rate relative to that at rest, and
x / c the inertial number over its constant I0.
It is quadratic in x (as in Dunatunga and Kamrin 2015, J. Fluid Mech. 779:483, for a shear stress)."""

from mpm.backend import once, ti

TINY = 1e-30
"""Guards 0/0 where a deviator vanishes; below the square of any strain that single precision can hold."""
MAX_VOLUME_CORRECTION = 0.5
"""Largest logarithmic expansion that a particle remembers, to recover it when it is compressed again."""
SLOPE, APEX, CUT, RATIO, KAPPA = 2, 3, 4, 5, 6
"""Places of the cone's numbers among a law's: strain slope, volumetric strains of the apex and of the largest tension,
R and kappa [1/s]."""


@ti.func
def yielding_share(norm, allowed, soft: ti.template()):
    """Return 1 where the norm of a strain deviator exceeds the allowed one, else 0.
    With soft > 0 it is a smooth step of that relative width: derivatives do not jump from particle to particle, and are
    no longer exactly those of the motion."""
    if ti.static(soft > 0):
        beyond = (norm / (allowed + TINY) - 1.0) / soft
        return 1.0 / (1.0 + ti.exp(-ti.min(ti.max(beyond, -30.0), 30.0)))
    else:
        return ti.select(allowed < norm, 0.0 * norm + 1.0, 0.0 * norm)


@ti.func
def map_onto_cone(h: ti.template(), vc: ti.template(), p: ti.template(), dt, has_rate: ti.template()):
    """Return (h, vc): scale the deviator onto the cone at constant volume, cut tension off. What has parted still has
    the shear strength of its volume, which ends at the apex."""
    trace = h[0] + h[1] + h[2] + vc
    mean = (h[0] + h[1] + h[2]) / 3.0
    d = [once(h[0] - mean), once(h[1] - mean), once(h[2] - mean)]
    norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (h[3] * h[3] + h[4] * h[4] + h[5] * h[5]) + TINY)
    allowed = ti.max(p[SLOPE] * (p[APEX] - trace), 0.0)
    scale = 0.0 * norm
    if ti.static(has_rate):
        c, _slope = rate_scale(trace, p, dt)
        gain = (p[RATIO] - 1.0) * p[SLOPE] * ti.max(-trace, 0.0)
        scale = ti.select(allowed < norm, 1.0 - plastic_strain(norm, allowed, gain, c)[0] / norm, 0.0 * norm + 1.0)
    else:
        scale = ti.min(allowed / norm, 1.0)
    kept = ti.min(trace, p[CUT])
    third = kept / 3.0
    expansion = ti.min(trace - kept, MAX_VOLUME_CORRECTION)
    return [once(third + scale * d[0]), once(third + scale * d[1]), once(third + scale * d[2]),
            once(scale * h[3]), once(scale * h[4]), once(scale * h[5])], expansion


@ti.func
def rate_scale(trace, p: ti.template(), dt):
    """Return c of a substep, and its derivative by the volumetric strain that presses, -trace."""
    root = ti.sqrt(ti.max(-trace, 0.0) + TINY)
    return dt * p[KAPPA] * root, 0.5 * dt * p[KAPPA] / root


@ti.func
def plastic_strain(norm, allowed, gain, c):
    """Return x of a deviator that flows, and the root of the discriminant of its equation.
    gain: by which the norm that is allowed grows towards infinite rate."""
    b = c + allowed + gain - norm
    excess = ti.max(norm - allowed, 0.0)
    root = ti.sqrt(b * b + 4.0 * c * excess + TINY)
    # the same root of the quadratic twice; each form cancels where the other does not
    return ti.select(b > 0.0, 2.0 * c * excess / (ti.abs(b) + root), 0.5 * (root - b)), root


@ti.func
def map_onto_cone_back(h: ti.template(), vc: ti.template(), p: ti.template(), dt, bar: ti.template(), vc_bar,
                       soft: ti.template(), has_rate: ti.template()):
    """Return the adjoints of h, vc and p, from those of the mapped h and vc; soft: see `yielding_share`."""
    trace = h[0] + h[1] + h[2] + vc
    mean = (h[0] + h[1] + h[2]) / 3.0
    d = [once(h[0] - mean), once(h[1] - mean), once(h[2] - mean), h[3], h[4], h[5]]
    norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) + TINY)
    zero = 0.0 * trace
    allowed = ti.max(p[SLOPE] * (p[APEX] - trace), 0.0)
    yields, whole = allowed < norm, trace < p[CUT]
    share = yielding_share(norm, allowed, soft)
    along = d[0] * bar[0] + d[1] * bar[1] + d[2] * bar[2] + d[3] * bar[3] + d[4] * bar[4] + d[5] * bar[5]
    left_bar = share * along / norm  # of the norm that stays
    scale = 0.0 * trace
    allowed_bar, norm_bar, slope_bar, ratio_bar, press_bar, kappa_bar = left_bar, zero, zero, zero, zero, zero
    if ti.static(has_rate):
        c, slope = rate_scale(trace, p, dt)
        press = ti.max(-trace, 0.0)
        gain = (p[RATIO] - 1.0) * p[SLOPE] * press
        x, root = plastic_strain(norm, allowed, gain, c)
        scale = ti.select(yields, 1.0 - x / norm, zero + 1.0)
        allowed_bar = left_bar * (x + c) / root
        norm_bar = left_bar * (1.0 - (x + c) / root)
        # x - (norm - allowed), which would cancel, is -gain x / (x + c)
        c_bar = -left_bar * gain * x / ((x + c + TINY) * root)
        gain_bar = left_bar * x / root
        slope_bar = gain_bar * (p[RATIO] - 1.0) * press
        ratio_bar = gain_bar * p[SLOPE] * press
        press_bar = ti.select(trace < 0.0, c_bar * slope + gain_bar * (p[RATIO] - 1.0) * p[SLOPE], zero)
        kappa_bar = c_bar * c / p[KAPPA]
    else:
        scale = ti.select(yields, allowed / norm, zero + 1.0)
    held = ti.select(p[SLOPE] * (p[APEX] - trace) > 0.0, allowed_bar, zero)
    kept_bar = (bar[0] + bar[1] + bar[2]) / 3.0
    free = ti.select(trace - ti.min(trace, p[CUT]) < MAX_VOLUME_CORRECTION, vc_bar, zero)
    # the expansion is trace - kept: nothing of it where all is kept
    trace_bar = ti.select(whole, kept_bar, free) - p[SLOPE] * held - press_bar
    turn = (left_bar * scale - norm_bar) / norm
    shape = [once(scale * bar[i] - turn * d[i] * (1.0 if ti.static(i < 3) else 2.0)) for i in range(6)]
    average = (shape[0] + shape[1] + shape[2]) / 3.0
    state = [once(shape[i] + (trace_bar - average if ti.static(i < 3) else 0.0)) for i in range(6)]
    cut_bar = ti.select(whole, zero, kept_bar - free)
    p_bar = [zero, zero, (p[APEX] - trace) * held + slope_bar, p[SLOPE] * held, cut_bar, ratio_bar, kappa_bar]
    return state, trace_bar, ti.static(p_bar if has_rate else p_bar[:RATIO])

"""The yield condition that return mappings share."""

from mpm.backend import ti

TINY = 1e-30
"""Guards 0/0 where a deviator vanishes; below the square of any strain that single precision can hold."""


@ti.func
def yielding_share(norm, allowed, soft: ti.template()):
    """Return 1 where the norm of a strain deviator exceeds the allowed one, else 0.

    With soft > 0 it is a smooth step of that relative width: derivatives do not jump from particle to particle, and are
    no longer exactly those of the motion.
    """
    if ti.static(soft > 0):
        beyond = (norm / (allowed + TINY) - 1.0) / soft
        return 1.0 / (1.0 + ti.exp(-ti.min(ti.max(beyond, -30.0), 30.0)))
    else:
        return ti.select(allowed < norm, 0.0 * norm + 1.0, 0.0 * norm)

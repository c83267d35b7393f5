"""Stiffness that follows density: what a particle's stress is multiplied by, and the density that this is of."""

import itertools
from collections.abc import Sequence

import numpy as np

from mpm.backend import once, ti
from mpm.materials.material import stiffens_with_density

LEAST = 0.3
"""Smallest share of the stiffness: a lone particle with it is stable at the bound of a packing."""
CHANGE = 0.1
"""Share of the mass in force by which that around a particle can differ from it: a vibration of a bed changes it by
less."""


def mass_around(places: np.ndarray, masses: np.ndarray, periods: Sequence[int] = (0, 0, 0)) -> np.ndarray:
    """Return the mass [kg] (n,) of the nodes around particles, by the particles' weights, see `ParticleFields.around`.
    places: (n, 3) in cells from a node. masses: [kg] (n,). periods: cells after which an axis repeats, 0: never."""
    base = np.floor(places - 0.5).astype(int)
    f = places - base
    w = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])
    base -= base.min(0)
    shape = np.where(periods, periods, base.max(0) + 3)
    nodes, around = np.zeros(shape), np.zeros(len(places))
    steps = list(itertools.product(range(3), repeat=3))
    for i, j, k in steps:
        np.add.at(nodes, tuple(((base + (i, j, k)) % shape).T), w[i, :, 0] * w[j, :, 1] * w[k, :, 2] * masses)
    for i, j, k in steps:
        around += w[i, :, 0] * w[j, :, 1] * w[k, :, 2] * nodes[tuple(((base + (i, j, k)) % shape).T)]
    return around


def share_at(density: np.ndarray, packed: float) -> np.ndarray:
    """Return the share of the stiffness (n,) at densities of the material around particles (n,), and when packed, on
    the host, see `share_of`."""
    return np.clip(density / packed, LEAST, 1.0)


@ti.func
def firmness(fields: ti.template(), P: ti.template(), q, density):
    """Return the share of a law's stiffness that the particles of pack q have: the density of the material around them
    as a share of its density [kg/m^3] when packed, from LEAST to 1.
    A particle with few others is stopped by few nodes of little mass: as stiff as one inside a bed, it would need half
    of the time step, though what it carries matters to nothing."""
    return share_of(P.around[q] / (density * ti.static(fields.cell**3)))


@ti.func
def share_of(filled):
    """Return the share of the stiffness at a density, which is given as a share of that of a packing."""
    return once(ti.max(ti.min(filled, 1.0), LEAST))


@ti.func
def numbers_of(fields: ti.template(), P: ti.template(), law: ti.template(), q, density, p: ti.template()):
    """Return the numbers of a law for pack q, whose density [kg/m^3] when packed is given; p: those of its body."""
    if ti.static(stiffens_with_density(law)):
        return law.soften(p, firmness(fields, P, q, density))
    else:
        return p


@ti.func
def take_up_density(fields: ti.template(), P: ti.template(), q, density):
    """Take up the density that was noted around the particles of pack q, as far as it differs by more than CHANGE.
    A stiffness that followed every vibration, a stride late, would drive it. A particle that gets stiffer keeps its
    stress, one that gets softer its strain: neither gains energy."""
    before, full = P.around[q], density * ti.static(fields.cell**3)
    after = density_to_take_up(P, q)
    kept = ti.min(share_of(before / full) / share_of(after / full), 1.0)
    P.around[q] = after
    for i in ti.static(range(6)):
        P.e[i][q] = kept * P.e[i][q]


@ti.func
def density_to_take_up(P: ti.template(), q):
    """Return what `around` of pack q is to be: as it was, or the closest from which that noted differs by CHANGE."""
    return once(ti.max(ti.min(P.around[q], P.noted[q] / (1.0 - CHANGE)), P.noted[q] / (1.0 + CHANGE)))

"""Profile of a round deposit: depth over radius, rim, summit, and the reference's closed profile."""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

RING = 0.1
"""Width of a ring of the profile, in column radii."""
THIN = 0.01
"""Depth at which the deposit ends, in column radii: 1 mm for a column of 0.1 m, some two grains of sand."""
TOP = 0.5
"""Radius within which a straight line through the depths leads to the summit, in column radii."""


class Profile(NamedTuple):
    """Depth of a deposit over the radius; lengths are in column radii."""

    radii: np.ndarray
    """(n,) middles of the rings."""
    depths: np.ndarray
    """(n,) volume over area of each ring."""


def measure_profile(radii: np.ndarray, volumes: np.ndarray, share: float = 1.0) -> Profile:
    """Return the profile of particles, up to one empty ring.

    radii (n,): of the particles, in column radii. volumes (n,): in cubes of the column's radius. share: of the whole
    round that the particles fill, 0.25 for a quarter.
    """
    edges = np.arange(math.floor(radii.max() / RING) + 3) * RING
    areas = share * math.pi * np.diff(edges**2)
    return Profile(edges[:-1] + RING / 2, np.histogram(radii, edges, weights=volumes)[0] / areas)


def find_rim(profile: Profile, thin: float = THIN) -> float:
    """Return the outermost radius at which the depth is `thin`, by a straight line between rings."""
    r, h = profile
    k = int(np.flatnonzero(h >= thin)[-1])
    return float(r[k] + (h[k] - thin) / (h[k] - h[k + 1]) * RING)


def find_summit(profile: Profile) -> float:
    """Return the depth at the axis, by a straight line through the rings inside TOP."""
    inner = profile.radii < TOP
    return float(np.polyfit(profile.radii[inner], profile.depths[inner], 1)[1])


def volume_of(profile: Profile) -> float:
    """Return the volume of the round deposit, in cubes of the column's radius."""
    return float(np.sum(2 * math.pi * profile.radii * profile.depths) * RING)


def profile_difference(profile: Profile, reference: np.ndarray) -> float:
    """Return the volume between a profile and reference depths (n,) at its radii, over that of the reference.

    The profile is scaled to the reference's volume first, so that its own expansion does not count.
    """
    area = 2 * math.pi * profile.radii * RING
    scale = float(np.sum(area * reference)) / volume_of(profile)
    return float(np.sum(area * np.abs(scale * profile.depths - reference)) / np.sum(area * reference))


def closed_depths(radii: np.ndarray, summit: float, rim: float, volume: float) -> np.ndarray:
    """Return depths (n,) of the profile that summit, rim and volume determine, all in column radii.

    It is summit (1 - r / rim)^n, or a cone with a flat top where the volume is more than a cone's. Raises ValueError
    for a volume above that of a cylinder.
    """
    if not 0.0 < volume < math.pi * rim**2 * summit:
        raise ValueError(f"volume {volume:g}; accepted: above 0, below {math.pi * rim**2 * summit:g}")
    # volume = 2 pi summit rim^2 / ((n + 1) (n + 2))
    power = (math.sqrt(1.0 + 8.0 * math.pi * summit * rim**2 / volume) - 3.0) / 2.0
    if power >= 1.0:
        return summit * np.clip(1.0 - radii / rim, 0.0, 1.0) ** power
    top = brentq(lambda c: math.pi * summit * (rim**2 + rim * c + c * c) / 3.0 - volume, 0.0, rim)
    return summit * np.clip((rim - radii) / (rim - float(top)), 0.0, 1.0)  # pyright: ignore[reportArgumentType]

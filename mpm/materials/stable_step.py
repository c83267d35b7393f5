"""The largest stable time step."""

import math
from collections.abc import Iterable
from typing import Any

from mpm.errors import InvalidValue, TimeStepTooLarge
from mpm.materials.material import stiffens_with_density

COURANT_FRACTION = 0.75
"""Default share of the isolated-particle bound: leaves room for compression, which stiffens the logarithmic strain."""
ACCEPTED_FRACTION = 0.83
"""Largest accepted share of the isolated-particle bound. At sqrt(3) / 2 = 0.866 the phase of a lone particle turns by a
third of a circle in a step, and from there to 1 its modes can resonate three at a time: its strain then grows although
every mode is stable (docs/concepts/field.md). 4 % less leaves room for a strain of 1 %, which shifts the phases."""
PACKED, CROWDED = 0.36, 0.58
"""Of a law that stiffens with density: square of the largest angular frequency of any packing, in those of a lone
particle as stiff as its law says. The first is that of clumps, the second, times the ratio of the moduli of a plane
wave and of a lone particle, that of beds, heaps, layers and random packings of two or more particles a cell
(docs/concepts/field.md). On a lattice of one a cell it is the ratio itself."""
TRAVEL_FRACTION = 0.25
"""Largest share of a cell that a tool may travel in a substep, so that contact is seen before it is passed."""


def isolated_modulus(mu: float, lam: float) -> float:
    """Return the modulus [Pa] with which a lone particle resists its own grid: that of bulk, three times."""
    return 3.0 * lam + 2.0 * mu


def isolated_particle_bound(cell: float, density: float, mu: float, lam: float) -> float:
    """Return the bound [s] of a lone particle in 3-D: cell sqrt(density / (3 lam + 2 mu)).
    A lone particle feels its own pressure through the full grid gradient 4/dx^2, which is stricter than the wave speed
    of the bulk (Sun, Shinar & Schroeder 2020; Bai & Schroeder 2022)."""
    return cell * math.sqrt(density / isolated_modulus(mu, lam))


def viscous_bound(cell: float, density: float, viscosity: float) -> float:
    """Return the bound [s] that viscosity sets on a lone particle: density cell^2 / (4 viscosity).
    Its stress takes 8 viscosity dt / (density cell^2) off its own rate of shear in a step; more than twice diverges."""
    return density * cell**2 / (4.0 * viscosity) if viscosity > 0 else math.inf


def travel_bound(cell: float, speed: float) -> float:
    """Return the bound [s] from a collider's largest speed [m/s]."""
    return TRAVEL_FRACTION * cell / speed if speed > 0 else math.inf


def lone_bound(cell: float, law: Any) -> float:
    """Return the bound [s] of a lone particle as stiff as its law says, by elasticity and viscosity."""
    return min(isolated_particle_bound(cell, law.density, law.mu, law.lam),
               viscous_bound(cell, law.density, getattr(law, "viscosity", 0.0)))


def elastic_bound(cell: float, law: Any, volume: float) -> float:
    """Return the bound [s] that a material's stiffness sets: that of a lone particle, or of a packing where lone ones
    are soft. volume: of a particle [m^3]."""
    lone = isolated_particle_bound(cell, law.density, law.mu, law.lam)
    if not stiffens_with_density(law):
        return lone
    wave = (law.lam + 2.0 * law.mu) / isolated_modulus(law.mu, law.lam)
    coarse = min(max(2.0 * volume / cell**3 - 1.0, 0.0), 1.0)  # 0 for two or more particles a cell, 1 for one
    return lone / math.sqrt(max(PACKED, wave * (CROWDED + (1.0 - CROWDED) * coarse)))


def material_bound(cell: float, law: Any, share: float = 1.0, volume: float = 0.0) -> float:
    """Return the time step [s] at which a material becomes unstable; share: of the elastic bound.
    volume: of its largest particle [m^3]."""
    elastic = elastic_bound(cell, law, volume)
    return min(share * elastic, viscous_bound(cell, law.density, getattr(law, "viscosity", 0.0)))


def accepted_bound(cell: float, law: Any, volume: float = 0.0) -> float:
    """Return the largest accepted time step [s] of a material: one in which a lone particle cannot resonate."""
    return material_bound(cell, law, ACCEPTED_FRACTION, volume)


def check_step(dt: float, cell: float, laws: Iterable[Any], place: str = "", volume: float = 0.0) -> None:
    """Raise TimeStepTooLarge for a step [s] beyond the accepted one of some of the materials.
    place: where the step was given, for the message. volume: of the largest particle [m^3]."""
    bound, law = min(((accepted_bound(cell, law, volume), law) for law in laws), key=lambda pair: pair[0])
    if dt > bound:
        limit = "packing of grains" if stiffens_with_density(law) else "isolated particle"
        raise TimeStepTooLarge(dt, bound, limit + (f"; {place}" if place else ""))


def choose_step(dt: float | None, cell: float, laws: list[Any], volume: float = 0.0) -> float:
    """Return dt [s], or for None `COURANT_FRACTION` of the smallest bound of the materials.
    volume: of the largest particle [m^3].
    Raises TimeStepTooLarge beyond the accepted bound, InvalidValue for what is no time."""
    if dt is None:
        return COURANT_FRACTION * min(material_bound(cell, law, 1.0, volume) for law in laws)
    if not dt > 0:
        raise InvalidValue(f"Solver: dt = {dt} s; accepted: a positive time, or None")
    check_step(dt, cell, laws, volume=volume)
    return dt

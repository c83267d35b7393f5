"""The largest stable time step."""

import math
from typing import Any

from mpm.errors import InvalidValue, TimeStepTooLarge

COURANT_FRACTION = 0.75
"""Default share of the isolated-particle bound: leaves room for compression, which stiffens the logarithmic strain."""
TRAVEL_FRACTION = 0.25
"""Largest share of a cell that a tool may travel in a substep, so that contact is seen before it is passed."""


def isolated_particle_bound(cell: float, density: float, mu: float, lam: float) -> float:
    """Return the bound [s] of a lone particle in 3-D: cell sqrt(density / (3 lam + 2 mu)).

    A lone particle feels its own pressure through the full grid gradient 4/dx^2, which is stricter than the wave
    speed of the bulk (Sun, Shinar & Schroeder 2020; Bai & Schroeder 2022).
    """
    return cell * math.sqrt(density / (3.0 * lam + 2.0 * mu))


def viscous_bound(cell: float, density: float, viscosity: float) -> float:
    """Return the bound [s] that viscosity sets on a lone particle: density cell^2 / (4 viscosity).

    Its stress takes 8 viscosity dt / (density cell^2) off its own rate of shear in a step; more than twice diverges.
    """
    return density * cell**2 / (4.0 * viscosity) if viscosity > 0 else math.inf


def travel_bound(cell: float, speed: float) -> float:
    """Return the bound [s] from a collider's largest speed [m/s]."""
    return TRAVEL_FRACTION * cell / speed if speed > 0 else math.inf


def material_bound(cell: float, law: Any) -> float:
    """Return the time step [s] at which a lone particle of a material becomes unstable."""
    elastic = isolated_particle_bound(cell, law.density, law.mu, law.lam)
    return min(elastic, viscous_bound(cell, law.density, getattr(law, "viscosity", 0.0)))


def choose_step(dt: float | None, bound: float) -> float:
    """Return dt [s], or `COURANT_FRACTION` of the bound [s] for None; raise TimeStepTooLarge beyond the bound."""
    if dt is None:
        return COURANT_FRACTION * bound
    if not dt > 0:
        raise InvalidValue(f"Solver: dt = {dt} s; accepted: a positive time, or None")
    if dt > bound:
        raise TimeStepTooLarge(dt, bound, "isolated particle")
    return dt

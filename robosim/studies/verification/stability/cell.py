"""Result of a cell of the matrix, and the sand that the cells have in common."""

from dataclasses import dataclass, field

import numpy as np

import mpm

G, DENSITY, NU = 9.81, 1500.0, 0.3
"""Gravity [m/s^2], density [kg/m^3], Poisson's ratio [-]."""


@dataclass(frozen=True)
class CellResult:
    """Verdict and readings at one value of an axis."""

    axis: str
    """Name of the axis."""
    value: float | str
    """Value along the axis."""
    verdict: str
    """"stable", "refused" or "unstable"."""
    reason: str = ""
    """What failed first, or why the value is refused."""
    readings: dict[str, float] = field(default_factory=dict)
    """Largest or smallest values over the run."""


Outcome = tuple[str, dict[str, float]]
"""What failed first, "" if nothing did, and readings. A function that runs a cell may raise what refuses the scene."""


def make_sand(E: float = 1e5, phi: float = 30.0) -> mpm.DruckerPrager:
    """Make sand of Young's modulus E [Pa] and friction angle phi [deg]."""
    return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi)


def sound_speed(E: float) -> float:
    """Return the speed [m/s] of pressure waves in sand of Young's modulus E [Pa]."""
    return float(np.sqrt(E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)) / DENSITY))


def principal_stretches(solver: mpm.Solver) -> np.ndarray:
    """Return the principal stretches (n, 3) of the solver's particles."""
    e = solver.state()["e"].astype(float)
    b = np.eye(3) + e[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    return np.sqrt(np.linalg.eigvalsh(b))

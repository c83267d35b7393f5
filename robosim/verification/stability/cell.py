"""One cell of the stability matrix, and the sand of all of them."""

from dataclasses import dataclass, field

import numpy as np

import mpm

G, DENSITY, NU = 9.81, 1500.0, 0.3


@dataclass(frozen=True)
class Verdict:
    """One cell of the matrix."""

    axis: str
    value: float | str
    verdict: str
    """"stable", "refused" or "unstable"."""
    reason: str = ""
    readings: dict[str, float] = field(default_factory=dict)


def sound(E: float) -> float:
    """Speed of pressure waves [m/s]."""
    return float(np.sqrt(E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)) / DENSITY))


def sand(E: float = 1e5, phi: float = 30.0) -> mpm.DruckerPrager:
    """The sand of the matrix."""
    return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi)


def stretches(solver: mpm.Solver) -> np.ndarray:
    """Principal stretches (n, 3)."""
    e = solver.state()["e"].astype(float)
    b = np.eye(3) + e[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    return np.sqrt(np.linalg.eigvalsh(b))


def verdict_of(axis: str, value: float | str, failed: str, seen: dict[str, float]) -> Verdict:
    """The verdict on a cell: unstable for what failed, if anything did."""
    return Verdict(axis, value, "unstable" if failed else "stable", failed, seen)

"""Result of a cell of the matrix, its checks, and the sand that the cells have in common."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

import mpm

G, DENSITY, NU = 9.81, 1500.0, 0.3
"""Gravity [m/s^2], density [kg/m^3], Poisson's ratio [-]."""
DEFINITIONS = {
    "particles": "finite; every principal stretch between 0.05 and 20; no particle outside the walls; speeds below "
    "twice what the drop gives plus a tenth of the sound speed; energy never more than 1 % above the start's; momentum "
    "accounted for to 1e-5 of what was exchanged",
    "particles and bodies": "the same for both together; a body at rest within 0.3 mm of its height at MuJoCo steps of "
    "0.2 ms",
    "arm": "finite; motors within their torques; joints within their ranges to a degree; the tool within a millimetre "
    "of its target, without a joint faster than the data sheet allows",
}
"""What "stable" means for each subject."""


@dataclass(frozen=True)
class CellResult:
    """Verdict and readings at one value of an axis."""

    axis: str
    value: float | str
    verdict: str
    """"stable", "refused" or "unstable"."""
    reason: str = ""
    """What failed first, or why the value is refused."""
    readings: dict[str, float] = field(default_factory=dict)
    """Largest or smallest values over the run."""


Outcome = tuple[str, dict[str, float]]
"""What failed first, "" if nothing did, and readings. A function that runs a cell may raise what refuses the scene."""


def raise_to(readings: dict[str, float], **values: Any) -> None:
    """Keep the largest values as readings."""
    for name, value in values.items():
        readings[name] = max(readings[name], float(value))


def find_failure(readings: dict[str, float], speed: float) -> str:
    """Return which of speed, with its limit [m/s], energy and momentum is beyond what DEFINITIONS allows; or ""."""
    fastest = max(readings["fastest_m_s"], readings.get("fastest_box_m_s", 0.0))
    if fastest > speed:
        return f"speed {fastest:.3g} m/s above {speed:.3g}"
    if readings["energy_gain"] > 0.01:
        return f"energy {readings['energy_gain']:.2%} above the start's"
    return f"momentum off by {readings['momentum']:.2g}" if readings["momentum"] > 1e-5 else ""


def make_sand(E: float = 1e5, phi: float = 30.0) -> mpm.DruckerPrager:
    """Make sand of Young's modulus E [Pa] and friction angle phi [deg]."""
    return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi)


def sound_speed(E: float) -> float:
    """Return the speed [m/s] of pressure waves in sand of Young's modulus E [Pa]."""
    return float(np.sqrt(E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)) / DENSITY))


def check_stretches(solver: mpm.Solver) -> tuple[float, str]:
    """Return the smallest principal stretch of the solver's particles, and what is wrong with the stretches or ""."""
    e = solver.state()["e"].astype(float)
    stretches = np.sqrt(np.linalg.eigvalsh(np.eye(3) + e[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]))
    least, most = stretches.min(), stretches.max()
    return float(least), f"stretch {least:.3g} .. {most:.3g}" if least < 0.05 or most > 20 else ""

"""Resistive force theory: stress on a plate per depth, by its direction and that of its motion.
A plate rises by the attack angle beta towards +x and moves along (cos gamma, 0, -sin gamma): gamma = 90 deg is vertical
intrusion, -90 deg withdrawal. The force on it is (-alpha_x, alpha_z) times depth and area. Coefficients and their
sources are in configs/references/resistive_force_2d.yaml and resistive_force_3d.yaml."""

import math
from typing import NamedTuple

import numpy as np

from robosim.studies.verification.cases.references import read_reference


class Alpha(NamedTuple):
    """Stress per depth."""

    x: float
    """Against the horizontal part of the motion, as gamma = 0 has it."""
    z: float
    """Upwards."""


def plane_alpha(beta_deg: float, gamma_deg: float, medium: str = "generic") -> Alpha:
    """Return alpha [N/cm^3] of the plane theory, for angles [deg] from -90 to 90."""
    a00, a10, b11, b01, b_11, c11, c01, c_11, d10 = read_reference("resistive_force_2d")["media"][medium]
    b, g = math.radians(beta_deg), math.radians(gamma_deg)
    z = a00 + a10 * math.cos(2 * b) + b11 * math.sin(2 * b + g) + b01 * math.sin(g) + b_11 * math.sin(-2 * b + g)
    x = c11 * math.cos(2 * b + g) + c01 * math.cos(g) + c_11 * math.cos(-2 * b + g) + d10 * math.sin(2 * b)
    return Alpha(x, z)


def space_alpha(beta_deg: float, gamma_deg: float, psi_deg: float = 0.0, doubtful: bool = False) -> np.ndarray:
    """Return (alpha_r, alpha_theta, alpha_z) of the theory in space, in units of `space_scale`.
    The cap on the tangential part by the friction on the plate is left out. psi_deg: twist of the plate about
    the vertical. doubtful: take the third code's value of the two coefficients."""
    table = read_reference("resistive_force_3d")
    functions = {name: list(table[name]) for name in ("f1", "f2", "f3")}
    for entry in table["doubtful"] if doubtful else ():
        functions[entry["function"]][entry["term"]] = entry["value"]
    b, g, p = (math.radians(angle) for angle in (beta_deg, gamma_deg, psi_deg))
    x1, x2 = math.sin(g), math.cos(b)
    x3 = math.cos(p) * math.cos(g) * math.sin(b) + math.sin(g) * math.cos(b)
    terms = (1, x1, x2, x3, x1**2, x2**2, x3**2, x1 * x2, x2 * x3, x3 * x1, x1**3, x2**3, x3**3, x1 * x2**2, x2 * x1**2,
             x2 * x3**2, x3 * x2**2, x3 * x1**2, x1 * x3**2, x1 * x2 * x3)
    f1, f2, f3 = (float(np.dot(functions[name], terms)) for name in ("f1", "f2", "f3"))
    return np.array([f1 * math.sin(b) * math.cos(p) + f2 * math.cos(g), f1 * math.sin(b) * math.sin(p),
                     -f1 * math.cos(b) - f2 * math.sin(g) - f3])


def space_scale(mu: float) -> float:
    """Return the scale of the theory in space, in units of density times gravity. mu: internal friction coefficient."""
    cubic, square, linear = read_reference("resistive_force_3d")["scale"]
    return cubic * mu**3 + square * mu**2 + linear * mu

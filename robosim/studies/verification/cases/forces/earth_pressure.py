"""Coefficients of earth pressure: Rankine's and Coulomb's for a vertical wall and a level surface.

Angles are those of Mohr and Coulomb. In plane strain a Drucker-Prager cone that carries m in simple shear at constant
volume acts with the angle asin(m).
"""

import math


def rankine(phi_deg: float, passive: bool) -> float:
    """Return the horizontal stress on a smooth wall over the vertical stress."""
    sine = math.sin(math.radians(phi_deg))
    return (1 + sine) / (1 - sine) if passive else (1 - sine) / (1 + sine)


def coulomb_passive(phi_deg: float, wall_deg: float) -> float:
    """Return Coulomb's passive coefficient, of the force on a wall with a friction angle of wall_deg.

    The force is 0.5 density gravity depth^2 times it, inclined by wall_deg to the wall's normal.
    """
    phi, delta = math.radians(phi_deg), math.radians(wall_deg)
    root = math.sqrt(math.sin(phi + delta) * math.sin(phi) / math.cos(delta))
    return math.cos(phi) ** 2 / (math.cos(delta) * (1 - root) ** 2)

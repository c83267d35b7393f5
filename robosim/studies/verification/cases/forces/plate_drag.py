"""Upright blade that is drawn through sand at constant depth, with its upper edge above the surface, in plane strain.

Measured: relative error of the horizontal force where it begins to slip, its power of the depth, and its ratio between
two speeds. A reading, the immersion, is the depth at which a shell still acts, a cell below its edge. Reference:
Coulomb's wedge in front of a rough wall, 0.5 density gravity depth^2 K_p cos(wall's friction angle).
"""

import math

import numpy as np

from robosim.studies.verification.cases.case import Comparison, Record, case, grid, make_record
from robosim.studies.verification.cases.expectations import Power, Ratio, Within
from robosim.studies.verification.cases.forces.earth_pressure import coulomb_passive
from robosim.studies.verification.cases.forces.plate_bed import DENSITY, FRICTION_DEG, E, G, Plate, make_sand, push

BED = (0.6, 0.2)
"""Length and height [m]."""
SPEED = 0.05
"""[m/s]: a blade that starts at once sends off a wave of some 2 kPa, density times both speeds, which has to fade."""
REACH = 1.0
"""Cells in front of a shell's face and edge within which it acts, so that the sand meets a deeper blade."""
BEGIN, END = 0.15, 0.30
"""Way of the blade [depths] over which the force is averaged."""


def compare(records: list[Record]) -> list[Comparison]:
    """Return the measured force by depth beside that of the wedge."""
    depths = np.linspace(0.02, 0.07, 21)
    measured: dict[str, list] = {}
    for record in records:
        label = record.label("friction", "cell", "speed")
        measured.setdefault(label, []).append((record.choices["depth"], record.readings["drag"], label))
    published = {f"wedge, friction {mu:g}": [(float(d), predict(float(d), mu), "") for d in depths] for mu in
                 sorted({float(record.choices["friction"] or 0.0) for record in records})}
    return [Comparison(title="drag of a blade", x="depth [m]", y="force [N/m]", measured=measured, published=published,
                       uncertainty=0.2, is_relative=True, is_logarithmic=True)]


@case(
    source="Coulomb's wedge (1776): 0.5 rho g d^2 K_p cos(delta), with a plane slip surface; speed: friction does not "
           "depend on it",
    sweep=[*grid(depth=(0.03, 0.045, 0.06)), *grid(depth=(0.06,), cell=(0.01, 0.0075)),
           *grid(depth=(0.06,), cell=(0.0075,), speed=(0.01, 0.1)), {"depth": 0.06, "friction": 0.0}],
    quick=grid(depth=(0.04, 0.06), cell=(0.01,)),
    expectations=(Within("force", 0.35),
                  Power("drag", "depth", 1.8, 2.2, {"cell": 0.005, "friction": 0.4, "speed": 0.05}),
                  Ratio("drag", "speed", (0.01, 0.1), 0.9, 1.1, {"cell": 0.0075, "depth": 0.06})),
    main_error="force", resolution="cell", compare=compare)
def measure(*, depth: float = 0.06, cell: float = 0.005, friction: float = 0.4, speed: float = SPEED,
            friction_deg: float = FRICTION_DEG, stiffness: float = E, precision: str = "f32") -> Record:
    """Run the case; return the relative error of the force.

    depth, cell [m]; friction: on the blade; speed [m/s]; friction_deg: whose tangent the sand carries in simple shear;
    stiffness: Young's modulus [Pa].
    """
    pushed = push(make_sand(friction_deg, stiffness), Plate(
        beta_deg=90.0, gamma_deg=0.0, start_depth=0.0, travel=END * depth, cell=cell, side=2 * depth,
        bed=(BED[0], 0.0, BED[1]), friction=friction, speed=speed, precision=precision))
    slips = pushed.travels > BEGIN * depth
    drag = -float(np.mean(pushed.stresses[slips, 0])) * 2 * depth
    expected = predict(depth, friction, friction_deg)
    return make_record([pushed.cost], {"force": drag / expected - 1},
                             {"drag": drag, "expected": expected, "depth": depth, "immersion": depth + REACH * cell})


def predict(depth: float, friction: float, friction_deg: float = FRICTION_DEG) -> float:
    """Return the force per width [N/m] of Coulomb's wedge in front of a blade of a depth [m]."""
    wall = math.degrees(math.atan(friction))
    phi = math.degrees(math.asin(math.tan(math.radians(friction_deg))))
    return 0.5 * DENSITY * G * depth**2 * coulomb_passive(phi, wall) * math.cos(math.radians(wall))

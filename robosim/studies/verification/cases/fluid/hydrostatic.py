"""Water, or sand without friction, at rest.

Measured: relative errors of the pressure gradient, of the pressure at the base and of the height. Reference: p = rho0 g
Z in material depth Z, and the height that the compression by this pressure leaves.
"""

from typing import Literal

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within

DEPTH, BULK, DENSITY, G, HEIGHT = 0.1, 1e5, 1000.0, 9.81, 0.0995095


@case(
    source="J = 1 - rho0 g Z / K for p = K (1 - J): height 0.0995095 m of 0.1 m at K = 1e5 Pa; peer: CB-Geo's column",
    sweep=grid(material=("water", "sand"), precision=("f32", "f64"), cells=(10, 20)),
    quick=grid(cells=(20,), precision=("f32",), material=("water", "sand")),
    expectations=each_within({"gradient": 0.02, "base": 0.02, "height": 2e-4}, {"cells": 20}),
    main_error="gradient", resolution="cells")
def measure(*, cells: int = 20, precision: str = "f32", material: str = "water",
            volume_rate: Literal["particle", "cell"] = "particle") -> Record:
    """Run the case; return the errors of gradient, base pressure and height.

    material: "water", or "sand" with a friction angle of zero, which must behave the same. volume_rate: see
    `mpm.NewtonianFluid`.
    """
    cell = DEPTH / cells
    positions = mpm.sample_box((0, 0, 0), (4 * cell, 4 * cell, DEPTH), cell / 2)
    depth = DEPTH - positions[:, 2]
    law = mpm.NewtonianFluid(bulk_modulus=BULK, density=DENSITY, viscosity=0.001, volume_rate=volume_rate)
    if material == "sand":
        law = mpm.DruckerPrager(E=3e5 * (1 - 2 * 0.3), nu=0.3, density=DENSITY, friction_angle_deg=0.0)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (4 * cell, 4 * cell, 0.12), cell), walls=mpm.Walls.all("roller"),
                        bodies=[mpm.Body(law, positions, volume=(cell / 2) ** 3)], precision=precision)
    timed = TimedSolver(solver)
    timed.settle(0.2)
    state = solver.state()
    if material == "water":
        pressure = -BULK * state["j"][:, 0].astype(float)
    else:  # Kirchhoff pressure of a volumetric Hencky strain
        pressure = -BULK * 0.5 * np.log1p(state["e"].astype(float)[:, :3]).sum(1)
    gradient, surface = np.polyfit(depth, pressure, 1)
    top = depth < cell
    base = surface + gradient * DEPTH
    return timed.record({
        "gradient": gradient / (DENSITY * G) - 1, "base": base / (DENSITY * G * DEPTH) - 1,
        "height": (solver.positions()[top, 2] + depth[top]).mean() / HEIGHT - 1})

"""Elastic column under its own weight, between rollers.

Measured: volume-weighted error of the axial stress, relative to the base's, and relative error of the settlement.
Reference: P_zz = -rho0 g (l0 - Z) for any law; E ln l / l = P for the settlement with Hencky's.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case
from robosim.studies.verification.cases.expectations import Within

LENGTH, E, NU, DENSITY, G = 0.2, 1e5, 0.3, 1500.0, 9.81
SETTLEMENT = 2.139780e-3


@case(
    source="statics; error measure of Coombs & Augarde 2020, Adv. Eng. Softw. 139:102748; settlement of the Hencky "
           "column from E ln l / l = P",
    sweep=[{"cells": n, "precision": p, "integrator": i}
           for p, i in (("f32", "series"), ("f32", "exact"), ("f64", "exact")) for n in (10, 20, 40)],
    quick=[{"cells": n, "precision": "f32", "integrator": "series"} for n in (10, 20, 40)],
    expectations=(Within("stress", 0.03, {"cells": 20}), Within("stress", 0.015, {"cells": 40}),
                  *(Within("settlement", 0.02, {"cells": n}) for n in (20, 40))),
    main_error="stress", resolution="cells")
def measure(*, cells: int = 20, precision: str = "f32", integrator: str | None = None) -> Record:
    """Run the case; return the errors of axial stress and settlement. cells: along the column."""
    cell = LENGTH / cells
    positions = mpm.sample_box((0, 0, 0), (4 * cell, 4 * cell, LENGTH), cell / 2)
    depth = LENGTH - positions[:, 2]
    law = mpm.Elastic(E=E, nu=NU, density=DENSITY)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (4 * cell, 4 * cell, 0.25), cell), walls=mpm.Walls.all("roller"),
                        bodies=[mpm.Body(law, positions, volume=(cell / 2) ** 3)], precision=precision,
                        integrator=integrator)
    timed = TimedSolver(solver)
    timed.settle(0.3)
    h = 0.5 * np.log1p(solver.state()["e"].astype(float)[:, :3])
    stress = (2 * law.mu * h[:, 2] + law.lam * h.sum(1)) / np.exp(h[:, 2])
    top = depth < cell
    settled = (LENGTH - depth - solver.positions()[:, 2])[top].mean()
    return timed.record({"stress": np.abs(stress + DENSITY * G * depth).mean() / (DENSITY * G * LENGTH),
                         "settlement": settled / SETTLEMENT - 1})

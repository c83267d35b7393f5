"""Elastic bodies at rest."""

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import courant_step, fill_box, set_up
from robosim.studies.verification.cases.case import Record, TimedSolver, case
from robosim.studies.verification.cases.expectations import Within, each_within

E, NU, DENSITY, WIDTH = 1e5, 0.3, 1000.0, 0.08
EXACT = {("hencky", 0.9): (-11706.724, 1.032113), ("hencky", 1.1): (8664.562, 0.9718119),
         ("hencky", 0.99): (-1015.185, 1.0030197), ("hencky", 1.01): (985.181, 0.9970194),
         ("fixed_corotated", 0.9): (-10390.234, 1.030628), ("fixed_corotated", 1.1): (9679.246, 0.9707300),
         ("fixed_corotated", 0.99): (-1003.566, 1.0030068), ("fixed_corotated", 1.01): (996.504, 0.9970069),
         ("neo_hookean", 0.9): (-10872.219, 1.031702), ("neo_hookean", 1.1): (9307.743, 0.9714929),
         ("neo_hookean", 0.99): (-1007.813, 1.0030160), ("neo_hookean", 1.01): (992.365, 0.9970158)}
"""First Piola stress [Pa] and lateral stretch of a law at an axial stretch, for the numbers above."""
COLUMN, COLUMN_DENSITY, G, SETTLEMENT = 0.2, 1500.0, 9.81, 2.139780e-3


@case(
    source="uniaxial stress of each law in closed form: the lateral stretch leaves no lateral stress",
    sweep=[{"model": m, "stretch": s, "cells": n} for m, s in EXACT for n in (4, 8, 12)],
    quick=[{"model": m, "stretch": s, "cells": 8} for m, s in EXACT if s in (0.9, 1.1)],
    expectations=each_within({"stress": 0.005, "stretch": 0.005}), main_error="stress", resolution="cells")
def uniaxial(*, model: str = "hencky", stretch: float = 0.9, cells: int = 8, courant: float = 0.3,
             precision: str = "f32") -> Record:
    """Uniaxial stress of a bar between frictionless walls, for each elastic law.

    Measured: relative errors of the axial first Piola stress and of the lateral strain. The bar starts stretched along
    its axis and comes to rest between the walls; then one wall is removed, and the momentum gained in the first substep
    is the other wall's pull. A quarter of the bar is computed; cells: across the whole bar."""
    cell, half = WIDTH / cells, WIDTH / 2
    length = 4 * cell
    law = mpm.Elastic(E=E, nu=NU, density=DENSITY, model=model)
    positions = mpm.sample_box((0, 0, 0), (length, half, half), cell / 2)
    body = mpm.Body(law, positions, volume=length * half * half / stretch / len(positions))
    dt = courant_step(courant, cell, law)

    def between_walls(room: float) -> mpm.Solver:
        return mpm.Solver(grid=mpm.Grid((0, 0, 0), (room, half + 4 * cell, half + 4 * cell), cell),
                          walls=mpm.Walls.all("roller"), gravity=(0, 0, 0), bodies=[body], precision=precision, dt=dt,
                          transfer_interval=0.0)  # many transfers bring it to rest

    solver = between_walls(length)
    state = solver.state()
    state["e"][:, 0] = stretch**2 - 1
    solver.load(state)
    timed = TimedSolver(solver)
    timed.settle(60.0 * WIDTH / np.sqrt(E / DENSITY))
    e = solver.state()["e"].astype(float)
    lateral = np.sqrt(1 + 0.5 * (e[:, 1] + e[:, 2])).mean()
    free = between_walls(length + 8 * cell)
    free.load(solver.state())
    before = free.momentum().linear[0]
    free.advance(dt)
    stress = -(free.momentum().linear[0] - before) / dt / half**2
    expected, thinner = EXACT[model, stretch]
    errors = {"stress": stress / expected - 1, "stretch": (lateral - 1) / (thinner - 1) - 1}
    return timed.record(errors, stress=stress, lateral=lateral, moving=np.abs(e[:, 3:]).max())


@case(
    source="statics: P_zz = -rho0 g (l0 - Z) for any law; error measure of Coombs & Augarde 2020, Adv. Eng. Softw. "
           "139:102748; settlement of the Hencky column from E ln l / l = P",
    sweep=[{"cells": n, "precision": p, "integrator": i}
           for p, i in (("f32", "series"), ("f32", "exact"), ("f64", "exact")) for n in (10, 20, 40)],
    quick=[{"cells": n, "precision": "f32", "integrator": "series"} for n in (10, 20, 40)],
    expectations=(Within("stress", 0.03, {"cells": 20}), Within("stress", 0.015, {"cells": 40}),
                  *(Within("settlement", 0.02, {"cells": n}) for n in (20, 40))),
    main_error="stress", resolution="cells")
def column_weight(*, cells: int = 20, precision: str = "f32", integrator: str | None = None) -> Record:
    """Elastic column under its own weight, between rollers.

    Measured: volume-weighted error of the axial stress, relative to the base's, and relative error of the settlement.
    cells: along the column."""
    cell = COLUMN / cells
    body = fill_box(mpm.Elastic(E=E, nu=NU, density=COLUMN_DENSITY), (0, 0, 0), (4 * cell, 4 * cell, COLUMN), cell)
    law, depth = body.material, COLUMN - body.positions[:, 2]
    timed, solver = set_up(body, (4 * cell, 4 * cell, 0.25), cell, walls=mpm.Walls.all("roller"), precision=precision,
                           integrator=integrator)
    timed.settle(0.3)
    h = 0.5 * np.log1p(solver.state()["e"].astype(float)[:, :3])
    stress = (2 * law.mu * h[:, 2] + law.lam * h.sum(1)) / np.exp(h[:, 2])
    settled = (COLUMN - depth - solver.positions()[:, 2])[depth < cell].mean()
    return timed.record({"stress": np.abs(stress + COLUMN_DENSITY * G * depth).mean() / (COLUMN_DENSITY * G * COLUMN),
                         "settlement": settled / SETTLEMENT - 1})

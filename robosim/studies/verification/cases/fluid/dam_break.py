"""Dam break: a water column twice as high as wide collapses over a dry floor.

Measured: relative errors of the front's position, mean and largest, and of its speed. Reference: the experiment of
Martin and Moyce (1952). Computed fronts lead the measured ones by about 10 %, because the experiment's membrane took
time to open.
"""

from typing import Literal

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import load_pressure
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within

WIDTH = 0.05715
FRONT = np.array([
    (0.832, 1.217), (1.219, 1.474), (1.997, 2.292), (2.547, 2.995), (3.345, 4.134), (4.034, 4.944), (4.418, 5.881),
    (5.091, 6.980)])
"""(T, Z): time in sqrt(a / 2 g), front in a."""
TIP = 0.0025
"""Share of the water that lies beyond the front: a mass, so that the front does not depend on the outermost grain."""
DENSITY, G = 1000.0, 9.81


@case(
    source="Martin & Moyce 1952, Phil. Trans. R. Soc. A 244:312, fig. 3, a = 2.25 in, digitised in PySPH's "
           "db_exp_data.py",
    sweep=[*grid(courant=(0.2, 0.4), cells=(10, 20, 40)), *grid(courant=(0.4,), tension=(False,), cells=(10, 20))],
    quick=grid(courant=(0.4,), cells=(10, 20)),
    # of the front for T <= 5.1 and of its speed from T = 2 to 5.1; the mean is signed
    expectations=[one for n in (20, 40)
                  for one in each_within({"mean": 0.15, "max": 0.18, "front speed": 0.08}, {"cells": n})],
    main_error="mean", resolution="cells")
def measure(*, cells: int = 20, courant: float = 0.4, precision: str = "f32", sound: float = 12.0,
            tension: bool = True, volume_rate: Literal["particle", "cell"] = "particle") -> Record:
    """Run the case; return the errors of the front. cells: across the column.

    sound: speed [m/s], at least ten times sqrt(g H), so that the water is nearly incompressible. tension,
    volume_rate: see `mpm.NewtonianFluid`.
    """
    cell, height = WIDTH / cells, 2 * WIDTH
    water = mpm.NewtonianFluid(bulk_modulus=DENSITY * sound**2, density=DENSITY, tension=tension,
                               volume_rate=volume_rate)
    positions = mpm.sample_box((0, 0, 0), (WIDTH, cell, height), cell / 2)
    walls = mpm.Walls(lower=("slip", "periodic", "slip"), upper=("slip", "periodic", "slip"))
    room = (8.5 * WIDTH, cell, 1.2 * height)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), room, cell), walls=walls, dt=courant * cell / sound,
                        bodies=[mpm.Body(water, positions, volume=(cell / 2) ** 3)], precision=precision)
    load_pressure(solver, water, height - positions[:, 2])
    timed = TimedSolver(solver)
    unit = np.sqrt(WIDTH / (2 * G))
    times, front = [0.0], [1.0]
    while solver.time < 5.2 * unit:
        timed.advance(0.05 * unit)
        times.append(solver.time / unit)
        front.append(float(np.quantile(solver.positions()[:, 0], 1 - TIP) / WIDTH))
    error = np.interp(FRONT[:, 0], times, front) / FRONT[:, 1] - 1
    window = FRONT[:, 0] >= 1.9
    computed = np.polyfit(FRONT[window, 0], np.interp(FRONT[window, 0], times, front), 1)[0]
    filmed = np.polyfit(FRONT[window, 0], FRONT[window, 1], 1)[0]
    errors = {"mean": error.mean(), "max": np.abs(error).max(), "front speed": computed / filmed - 1}
    return timed.record(errors, front_at_5=np.interp(5.0, times, front))

"""Dam break: a water column twice as high as wide collapses over a dry floor.

Measured: relative errors of the front's position, mean and largest, and of its speed. Reference: the experiment of
Martin and Moyce (1952). Computed fronts lead the measured ones by about 10 %, because the experiment's membrane took
time to open.
"""

from typing import Literal

import numpy as np

import mpm
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "dam_break"
SOURCE = "Martin & Moyce 1952, Phil. Trans. R. Soc. A 244:312, fig. 3, a = 2.25 in, digitised in PySPH's db_exp_data.py"
BANDS = {"mean": 0.15, "max": 0.18, "front speed": 0.08}
"""Relative errors at most, of the front for T <= 5.1 and of its speed from T = 2 to 5.1; the mean is signed."""
SWEEP = [*({"cells": n, "courant": c} for c in (0.2, 0.4) for n in (10, 20, 40)),
         *({"cells": n, "courant": 0.4, "tension": False} for n in (10, 20))]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"cells": n, "courant": 0.4} for n in (10, 20)]
MAIN_ERROR, RESOLUTION = "mean", "cells"
CLAIMS = tuple(Within(name, bound, {"cells": n}) for n in (20, 40) for name, bound in BANDS.items())
WIDTH = 0.05715
FRONT = np.array([
    (0.832, 1.217), (1.219, 1.474), (1.997, 2.292), (2.547, 2.995), (3.345, 4.134), (4.034, 4.944), (4.418, 5.881),
    (5.091, 6.980)])
"""(T, Z): time in sqrt(a / 2 g), front in a."""
TIP = 0.0025
"""Share of the water that lies beyond the front: a mass, so that the front does not depend on the outermost grain."""
DENSITY, G = 1000.0, 9.81


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
    state = solver.state()
    state["j"][:, 0] = -DENSITY * G * (height - positions[:, 2]) / water.bulk_modulus
    solver.load(state)
    timed = TimedSolver(solver)
    unit = np.sqrt(WIDTH / (2 * G))
    times, front = [0.0], [1.0]
    while solver.time < 5.2 * unit:
        timed.advance(0.05 * unit)
        times.append(solver.time / unit)
        front.append(float(np.quantile(solver.positions()[:, 0], 1 - TIP) / WIDTH))
    error = np.interp(FRONT[:, 0], times, front) / FRONT[:, 1] - 1
    window = (FRONT[:, 0] >= 1.9)
    computed = np.polyfit(FRONT[window, 0], np.interp(FRONT[window, 0], times, front), 1)[0]
    filmed = np.polyfit(FRONT[window, 0], FRONT[window, 1], 1)[0]
    errors = {"mean": error.mean(), "max": np.abs(error).max(), "front speed": computed / filmed - 1}
    choices = {"cells": cells, "courant": courant, "precision": precision, "sound": sound, "tension": tension,
               "volume_rate": volume_rate}
    return timed.record(NAME, choices, errors, front_at_5=float(np.interp(5.0, times, front)))

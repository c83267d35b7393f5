"""Axial vibration of a bar between a wall and a free end.

Measured: relative error of the frequency, its order, and the decay of the amplitude per period; the order is that of
the walls. Reference: the first mode of a fixed-free bar, omega = pi / (2 L) sqrt(E / rho).
"""

import numpy as np
from scipy.optimize import curve_fit

import mpm
from robosim.studies.verification.cases.claims import Order, Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "bar"
SOURCE = "first mode of a fixed-free bar, omega = pi/(2 L) sqrt(E/rho): Bardenhagen 2002; Steffen et al. 2008"
BANDS = {"frequency at 50 cells": 5e-4, "order": 1.8, "decay": 1e-3}
"""Relative errors at most; order of the frequency at least (zeroed walls: 1); decay per period at most."""
SWEEP = [{"cells": n, "courant": c, "precision": p} for p in ("f64", "f32") for c in (0.2, 0.5) for n in (13, 25, 50)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"cells": n, "courant": 0.2, "precision": "f64"} for n in (13, 25, 50)]
MAIN_ERROR, RESOLUTION = "frequency", "cells"
FINEST = {"courant": 0.2, "precision": "f64"}
CLAIMS = (Within("frequency", BANDS["frequency at 50 cells"], {"cells": 50, **FINEST}),
          Within("decay", BANDS["decay"], {"cells": 50, **FINEST}),
          Order("frequency", "cells", (13, 25), BANDS["order"], FINEST))
LENGTH, E, DENSITY, SPEED = 25.0, 100.0, 1.0, 0.1
BETA = np.pi / (2 * LENGTH)
OMEGA = BETA * np.sqrt(E / DENSITY)


def measure(*, cells: int = 50, courant: float = 0.2, precision: str = "f64", periods: float = 4) -> Record:
    """Run the case; return the error of the frequency and the decay. cells: along the bar."""
    cell = LENGTH / cells
    positions = mpm.sample_box((0, 0, 0), (LENGTH, 4 * cell, 4 * cell), cell / 2)
    velocity = np.zeros_like(positions)
    velocity[:, 0] = SPEED * np.sin(BETA * positions[:, 0])
    body = mpm.Body(mpm.Elastic(E=E, nu=0.0, density=DENSITY, model="neo_hookean"), positions,
                    volume=(cell / 2) ** 3, velocities=velocity)
    rollers = mpm.Walls.all("roller")
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (LENGTH + 3 * cell, 4 * cell, 4 * cell), cell), bodies=[body],
                        gravity=(0, 0, 0), walls=rollers, dt=courant * cell / np.sqrt(E / DENSITY),
                        precision=precision)
    timed = TimedSolver(solver)
    times, centre = [], []
    while solver.time < periods * 2 * np.pi / OMEGA:
        timed.advance(0.2)
        times.append(solver.time)
        centre.append(solver.positions()[:, 0].mean() - LENGTH / 2)

    def swing(t: np.ndarray, amplitude: float, omega: float, decay: float, shift: float, offset: float) -> np.ndarray:
        return offset + amplitude * np.exp(-decay * t) * np.sin(omega * t + shift)

    start = (SPEED / (BETA * LENGTH * OMEGA), OMEGA, 1e-5, 0.0, 0.0)
    fit, _ = curve_fit(swing, np.array(times), np.array(centre), p0=start)
    choices = {"cells": cells, "courant": courant, "precision": precision}
    return timed.record(NAME, choices, {"frequency": abs(fit[1] / OMEGA - 1), "decay": fit[2] * 2 * np.pi / OMEGA})

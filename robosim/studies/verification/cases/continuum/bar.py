"""Axial vibration of a bar between a wall and a free end.

Measured: relative error of the frequency, its order, and the decay of the amplitude per period; the order is that of
the walls. Reference: the first mode of a fixed-free bar, omega = pi / (2 L) sqrt(E / rho).
"""

import numpy as np
from scipy.optimize import curve_fit

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Order, each_within

LENGTH, E, DENSITY, SPEED = 25.0, 100.0, 1.0, 0.1
BETA = np.pi / (2 * LENGTH)
OMEGA = BETA * np.sqrt(E / DENSITY)


@case(
    source="first mode of a fixed-free bar, omega = pi/(2 L) sqrt(E/rho): Bardenhagen 2002; Steffen et al. 2008",
    sweep=grid(precision=("f64", "f32"), courant=(0.2, 0.5), cells=(13, 25, 50)),
    quick=grid(courant=(0.2,), precision=("f64",), cells=(13, 25, 50)),
    expectations=(*each_within({"frequency": 5e-4, "decay": 1e-3}, {"cells": 50, "courant": 0.2, "precision": "f64"}),
                  # with zeroed walls: 1
                  Order("frequency", "cells", (13, 25), 1.8, {"courant": 0.2, "precision": "f64"})),
    main_error="frequency", resolution="cells")
def measure(*, cells: int = 50, courant: float = 0.2, precision: str = "f64", periods: float = 4) -> Record:
    """Run the case; return the error of the frequency and the decay. cells: along the bar."""
    cell = LENGTH / cells
    positions = mpm.sample_box((0, 0, 0), (LENGTH, 4 * cell, 4 * cell), cell / 2)
    velocity = np.zeros_like(positions)
    velocity[:, 0] = SPEED * np.sin(BETA * positions[:, 0])
    body = mpm.Body(mpm.Elastic(E=E, nu=0.0, density=DENSITY, model="neo_hookean"), positions,
                    volume=(cell / 2) ** 3, velocities=velocity)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (LENGTH + 3 * cell, 4 * cell, 4 * cell), cell), bodies=[body],
                        gravity=(0, 0, 0), walls=mpm.Walls.all("roller"), precision=precision,
                        dt=courant * cell / np.sqrt(E / DENSITY))
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
    return timed.record({"frequency": abs(fit[1] / OMEGA - 1), "decay": fit[2] * 2 * np.pi / OMEGA})

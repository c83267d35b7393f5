"""Sheet of sand on a rough plane that is steeper than friction can hold.

Measured: relative error of the mean acceleration. Reference: a = g (sin theta - m3 cos theta). In steady simple shear
the cone carries tau / sigma_n = m3 at every depth, not tan(phi): atan(m3) is above phi for the cone of triaxial
compression, below it for plane strain.
"""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import courant_step
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Order, Within

HEIGHT, DENSITY, NU, G = 0.05, 1600.0, 0.3, 9.81
SETTLING, RAMP, FIT_FROM, END = 0.03, 0.03, 0.12, 0.30
"""[s]: damped rest under the normal pull, then from zero on the tangential pull's rise, and the span of the fit."""
WINDOW = 2e-3
"""Time [s] between readings, and between changes of gravity while it rises."""


def shear_ratio(phi_deg: float, cone: str) -> float:
    """Return m3 of sand with a friction angle [deg], from the cone's definition, not from the law under test."""
    sine = math.sin(math.radians(phi_deg))
    return sine if cone == "plane_strain" else 2.0 * math.sqrt(3.0) * sine / (3.0 - sine)


@case(
    source="balance of momentum of an infinite slope; m3 = 3 alpha / sqrt(2), the cone's shear ratio at constant "
           "volume",
    sweep=grid(courant=(0.2, 0.5), cells=(8, 16, 32)),
    quick=grid(courant=(0.5,), cells=(8, 16)),
    # the acceleration is nearer to the prediction than to g (sin theta - tan phi cos theta), the reading `by_angle`
    expectations=(Within("acceleration", 0.10, {"cells": 32}, -0.20),
                  *(Order("acceleration", "cells", ends, 0.0, {"courant": 0.5}) for ends in ((8, 16), (16, 32)))),
    main_error="acceleration", resolution="cells")
def measure(*, cells: int = 32, phi_deg: float = 30.0, theta_deg: float = 40.0, E: float = 2e5, courant: float = 0.5,
            precision: str = "f32", cone: str = "compression") -> Record:
    """Run the case; return the error of the acceleration. cells: over the height; E [Pa]."""
    sand = mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi_deg, cone=cone)
    cell = HEIGHT / cells
    grains = mpm.sample_box((0, 0, 0), (cell, cell, HEIGHT), cell / 2)
    walls = mpm.Walls(lower=("periodic", "periodic", "stick"), upper=("periodic", "periodic", "slip"))
    theta = math.radians(theta_deg)
    across, along = G * math.cos(theta), G * math.sin(theta)
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (cell, cell, 1.2 * HEIGHT), cell), walls=walls, gravity=(0, 0, -across),
        bodies=[mpm.Body(sand, grains, volume=(cell / 2) ** 3)], precision=precision,
        dt=courant_step(courant, cell, sand))
    timed = TimedSolver(solver)
    timed.settle(SETTLING)
    begin, mass = solver.time, solver.masses().sum()
    times, speeds = [], []
    while solver.time - begin < END - WINDOW / 2:
        risen = min((solver.time - begin + WINDOW / 2) / RAMP, 1.0)
        solver.set_gravity(np.array([risen * along, 0.0, -across]))
        timed.advance(WINDOW)
        times.append(solver.time - begin)
        speeds.append(solver.momentum_after_advance().linear[0] / mass)
    late = np.array(times) > FIT_FROM
    acceleration = np.polyfit(np.array(times)[late], np.array(speeds)[late], 1)[0]
    predicted = along - shear_ratio(phi_deg, cone) * across
    by_angle = along - math.tan(math.radians(phi_deg)) * across
    return timed.record({"acceleration": acceleration / predicted - 1}, acceleration=acceleration,
                        predicted=predicted, by_angle=by_angle, height=solver.positions()[:, 2].max() + cell / 4)

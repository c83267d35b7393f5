"""Steady flow down a rough incline of grains whose friction grows with the rate of shear.

Measured: largest error of the velocity over the depth, relative to the surface's, and relative error of the flux.
Reference: the profile of the mu(I) law of Jop et al. (2006) in closed form: the inertial number is the same at every
depth, so that friction equals the slope.
"""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import courant_step
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Order, Within
from robosim.studies.verification.cases.granular.slope import shear_ratio

HEIGHT, G = 0.04, 9.81
BULK, GRAIN, DIAMETER, INERTIAL = 1470.0, 2450.0, 2e-3, 0.279
"""Densities [kg/m^3] of bulk and grain, diameter [m] of a grain, inertial number I0."""
STATIC_DEG, LIMIT_DEG = 17.3, 28.0
"""Angles [deg] of the cone at rest and at infinite rate: ratios of shear to normal stress of 0.381 and 0.643."""
BEGIN = 0.5
"""Velocity at the start, relative to the reference."""


def reference(z: np.ndarray, theta_deg: float) -> np.ndarray:
    """Return the velocity [m/s] at heights z [m] above the bottom."""
    low, high = (shear_ratio(angle, "compression") for angle in (STATIC_DEG, LIMIT_DEG))
    slope = math.tan(math.radians(theta_deg))
    inertial = INERTIAL * (slope - low) / (high - slope)
    scale = 2.0 / 3.0 * inertial / DIAMETER * math.sqrt(BULK / GRAIN * G * math.cos(math.radians(theta_deg)))
    return scale * (HEIGHT**1.5 - np.maximum(HEIGHT - z, 0.0) ** 1.5)


@case(
    source="Jop, Forterre & Pouliquen (2006), Nature 441:727: u(z) = 2/3 I / d sqrt(rho g cos theta / rho_grain) "
           "(h^1.5 - (h - z)^1.5), tan theta = mu(I)",
    sweep=[*grid(theta_deg=(23.0, 26.0), cells=(10, 20)), {"cells": 20, "theta_deg": 23.0, "E": 1e6}],
    quick=[{"cells": 10, "theta_deg": 23.0}],
    expectations=(Within("profile", 0.06, {"cells": 10}), Within("profile", 0.03, {"cells": 20}),
                  Within("flux", 0.02, {"cells": 20}),
                  *(Order("profile", "cells", (10, 20), 0.5, {"theta_deg": t, "E": 2e5}) for t in (23.0, 26.0))),
    main_error="profile", resolution="cells")
def measure(*, cells: int = 20, theta_deg: float = 26.0, E: float = 2e5, courant: float = 0.5, duration: float = 9.0,
            precision: str = "f32") -> Record:
    """Run the case; return the errors of profile and flux. cells: over the depth; E [Pa]; duration [s]."""
    cell, theta = HEIGHT / cells, math.radians(theta_deg)
    law = mpm.MuIRheology(E=E, nu=0.3, density=BULK, friction_angle_deg=STATIC_DEG, limit_angle_deg=LIMIT_DEG,
                          grain_diameter=DIAMETER, grain_density=GRAIN, inertial_number=INERTIAL)
    grains = mpm.sample_box((0, 0, 0), (cell, cell, HEIGHT), cell / 2)
    volume = (cell / 2) ** 3
    speed = np.zeros_like(grains)
    speed[:, 0] = BEGIN * reference(grains[:, 2], theta_deg)
    stress = mpm.geostatic_stress(grains, volume, law, gravity=G * math.cos(theta), lateral=1.0)
    walls = mpm.Walls(lower=("periodic", "periodic", "stick"), upper=("periodic", "periodic", "slip"))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (cell, cell, 1.2 * HEIGHT), cell), walls=walls, precision=precision,
        gravity=(G * math.sin(theta), 0, -G * math.cos(theta)),
        dt=courant_step(courant, cell, law),
        bodies=[mpm.Body(law, grains, volume=volume, velocities=speed, stress=stress)])
    timed = TimedSolver(solver)
    timed.advance(duration)
    z, found = solver.positions()[:, 2], solver.state()["v"][:, 0]
    expected = reference(z, theta_deg)
    errors = {"profile": np.abs(found - expected).max() / expected.max(), "flux": found.sum() / expected.sum() - 1}
    return timed.record(errors, surface_speed=found.max(), surface_reference=expected.max(),
                        height=z.max() + cell / 4)

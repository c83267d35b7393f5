"""Slopes of sand: a sheet that slides, a heap at the limit, and a flow whose friction grows with its rate."""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import INCLINE, courant_step, fill_box, rms, set_up, shear_ratio
from robosim.studies.verification.cases.case import Record, case, grid
from robosim.studies.verification.cases.expectations import Order, Within

SHEET, SHEET_DENSITY, NU, G = 0.05, 1600.0, 0.3, 9.81
"""SHEET, FLOW: heights [m]."""
SETTLING, RAMP, FIT_FROM, END = 0.03, 0.03, 0.12, 0.30
"""[s]: damped rest under the normal pull, then from zero on the tangential pull's rise, and the span of the fit."""
WINDOW = 2e-3
"""Time [s] between readings, and between changes of gravity while it rises."""
BASE, HEAP_DENSITY, HEAP_E = 0.2, 1500.0, 1e5
HEAP_WALLS = mpm.Walls(friction=1.0, lower=("roller", "periodic", "friction"), upper=("slip", "periodic", "slip"))
"""A floor that sticks would pin the toe: at 16 cells a heap of 43 deg then stands."""
FLOW = 0.04
BULK, GRAIN, DIAMETER, INERTIAL = 1470.0, 2450.0, 2e-3, 0.279
"""Densities [kg/m^3] of bulk and grain, diameter [m] of a grain, inertial number I0."""
STATIC_DEG, LIMIT_DEG = 17.3, 28.0
"""Angles [deg] of the cone at rest and at infinite rate: ratios of shear to normal stress of 0.381 and 0.643."""


@case(
    source="balance of momentum of an infinite slope; m3 = 3 alpha / sqrt(2), the cone's shear ratio at constant "
           "volume",
    sweep=grid(courant=(0.2, 0.5), cells=(8, 16, 32)), quick=grid(courant=(0.5,), cells=(8, 16)),
    # the acceleration is nearer to the prediction than to g (sin theta - tan phi cos theta), the reading `by_angle`
    expectations=(Within("acceleration", 0.10, {"cells": 32}, -0.20),
                  *(Order("acceleration", "cells", ends, 0.0, {"courant": 0.5}) for ends in ((8, 16), (16, 32)))),
    main_error="acceleration", resolution="cells")
def slope(*, cells: int = 32, phi_deg: float = 30.0, theta_deg: float = 40.0, E: float = 2e5, courant: float = 0.5,
          precision: str = "f32", cone: str = "compression") -> Record:
    """Sheet of sand on a rough plane that is steeper than friction can hold.

    Measured: relative error of the mean acceleration. Reference: a = g (sin theta - m3 cos theta). In steady simple
    shear the cone carries tau / sigma_n = m3 at every depth, not tan(phi): atan(m3) is above phi for the cone of
    triaxial compression, below it for plane strain. cells: over the height."""
    sand = mpm.DruckerPrager(E=E, nu=NU, density=SHEET_DENSITY, friction_angle_deg=phi_deg, cone=cone)
    cell, theta = SHEET / cells, math.radians(theta_deg)
    across, along = G * math.cos(theta), G * math.sin(theta)
    timed, solver = set_up(fill_box(sand, (0, 0, 0), (cell, cell, SHEET), cell), (cell, cell, 1.2 * SHEET), cell,
                           walls=INCLINE, gravity=(0, 0, -across), precision=precision,
                           dt=courant_step(courant, cell, sand))
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
    return timed.record({"acceleration": acceleration / predicted - 1}, acceleration=acceleration, predicted=predicted,
                        by_angle=along - math.tan(math.radians(phi_deg)) * across,
                        height=solver.positions()[:, 2].max() + cell / 4)


@case(
    source="limit equilibrium of a slope without cohesion: it stands up to atan(m3)",
    sweep=grid(phi_deg=(20.0, 25.0, 30.0), beyond_deg=(-3.0, 8.0), cells=(16, 32)),
    quick=grid(phi_deg=(25.0,), beyond_deg=(-3.0, 8.0), cells=(16,)),
    expectations=(Within("change", 2.0, {"beyond_deg": -3.0}), Within("excess", 1.0, {"beyond_deg": 8.0}, -8.0)),
    main_error="excess", resolution="cells", units={"change": "deg", "excess": "deg"})
def heap(*, phi_deg: float = 25.0, beyond_deg: float = -3.0, cells: int = 32, courant: float = 0.5,
         precision: str = "f32", duration: float = 1.5, cone: str = "compression") -> Record:
    """Heap with a straight slope, below and above the steepest one that friction bears.

    Measured: change of the slope [deg], and its difference [deg] from the limit, in plane strain (m3: see `slope`).
    Inertia carries a slumping heap some degrees below the limit. Half of the heap is computed, one cell thick.
    beyond_deg: of the initial slope beyond the limit. cells: over the height."""
    sand = mpm.DruckerPrager(E=HEAP_E, nu=NU, density=HEAP_DENSITY, friction_angle_deg=phi_deg, cone=cone)
    limit = math.degrees(math.atan(shear_ratio(phi_deg, cone)))
    begin = limit + beyond_deg
    height = BASE * math.tan(math.radians(begin))
    cell = height / cells
    room = math.ceil(2.2 * BASE / cell) * cell
    positions = mpm.sample_box((0, 0, 0), (BASE, cell, height), cell / 2, np.random.default_rng(0))
    positions = positions[positions[:, 2] < (BASE - positions[:, 0]) * height / BASE]
    timed, solver = set_up(mpm.Body(sand, positions, volume=0.5 * BASE * height * cell / len(positions)),
                           (room, cell, 1.2 * height), cell, walls=HEAP_WALLS, precision=precision,
                           dt=courant_step(courant, cell, sand))
    timed.advance(duration)
    end = surface_slope(solver.positions(), cell)
    return timed.record({"change": end - begin, "excess": end - limit}, limit=limit, begin=begin,
                        slope=end, speed=rms(solver.velocities()))


def surface_slope(positions: np.ndarray, cell: float) -> float:
    """Return the surface's angle [deg] between a fifth and four fifths of the heap's height."""
    columns = np.floor(positions[:, 0] / cell).astype(int)
    tops = np.full(columns.max() + 1, -np.inf)
    np.maximum.at(tops, columns, positions[:, 2])
    x = (np.arange(len(tops)) + 0.5) * cell
    inner = (tops > 0.2 * tops.max()) & (tops < 0.8 * tops.max())
    return -math.degrees(math.atan(np.polyfit(x[inner], tops[inner], 1)[0]))


def flow_speed(z: np.ndarray, theta_deg: float) -> np.ndarray:
    """Return the reference's velocity [m/s] at heights z [m] above the bottom."""
    low, high = (shear_ratio(angle) for angle in (STATIC_DEG, LIMIT_DEG))
    incline = math.tan(math.radians(theta_deg))
    inertial = INERTIAL * (incline - low) / (high - incline)
    scale = 2.0 / 3.0 * inertial / DIAMETER * math.sqrt(BULK / GRAIN * G * math.cos(math.radians(theta_deg)))
    return scale * (FLOW**1.5 - np.maximum(FLOW - z, 0.0) ** 1.5)


@case(
    source="Jop, Forterre & Pouliquen (2006), Nature 441:727: u(z) = 2/3 I / d sqrt(rho g cos theta / rho_grain) "
           "(h^1.5 - (h - z)^1.5), tan theta = mu(I)",
    sweep=[*grid(theta_deg=(23.0, 26.0), cells=(10, 20)), {"cells": 20, "theta_deg": 23.0, "E": 1e6}],
    quick=[{"cells": 10, "theta_deg": 23.0}],
    expectations=(Within("profile", 0.06, {"cells": 10}), Within("profile", 0.03, {"cells": 20}),
                  Within("flux", 0.02, {"cells": 20}),
                  *(Order("profile", "cells", (10, 20), 0.5, {"theta_deg": t, "E": 2e5}) for t in (23.0, 26.0))),
    main_error="profile", resolution="cells")
def chute_flow(*, cells: int = 20, theta_deg: float = 26.0, E: float = 2e5, courant: float = 0.5,
               duration: float = 9.0, precision: str = "f32") -> Record:
    """Steady flow down a rough incline of grains whose friction grows with the rate of shear.

    Measured: largest error of the velocity over the depth, relative to the surface's, and relative error of the flux.
    Reference: the profile of the mu(I) law in closed form: the inertial number is the same at every depth, so that
    friction equals the slope. cells: over the depth; E [Pa]."""
    cell, theta = FLOW / cells, math.radians(theta_deg)
    law = mpm.MuIRheology(E=E, nu=NU, density=BULK, friction_angle_deg=STATIC_DEG, limit_angle_deg=LIMIT_DEG,
                          grain_diameter=DIAMETER, grain_density=GRAIN, inertial_number=INERTIAL)
    grains, volume = mpm.sample_box((0, 0, 0), (cell, cell, FLOW), cell / 2), (cell / 2) ** 3
    speed = np.zeros_like(grains)
    speed[:, 0] = 0.5 * flow_speed(grains[:, 2], theta_deg)  # it has to reach the reference
    stress = mpm.geostatic_stress(grains, volume, law, gravity=G * math.cos(theta), lateral=1.0)
    timed, solver = set_up(mpm.Body(law, grains, volume=volume, velocities=speed, stress=stress),
                           (cell, cell, 1.2 * FLOW), cell, walls=INCLINE, precision=precision,
                           gravity=(G * math.sin(theta), 0, -G * math.cos(theta)), dt=courant_step(courant, cell, law))
    timed.advance(duration)
    z, found = solver.positions()[:, 2], solver.state()["v"][:, 0]
    expected = flow_speed(z, theta_deg)
    errors = {"profile": np.abs(found - expected).max() / expected.max(), "flux": found.sum() / expected.sum() - 1}
    return timed.record(errors, surface_speed=found.max(), surface_reference=expected.max(), height=z.max() + cell / 4)

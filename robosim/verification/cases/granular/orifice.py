"""Discharge of sand from a slot in a flat floor.

Measured: relative error of the discharge's prefactor, relative change of its rate in time, and its power of the free
width. Reference: Q = C sqrt(g) D^(3/2) per thickness, independent of the height of the fill; that of a fluid would
fall. Half of the silo is computed, one cell thick. The slot is an odd number of cells wide, so that its edges lie
midway between nodes: a wall begins at the first node in it.
"""

import math

import numpy as np

import mpm
from robosim.verification.cases.claims import Power, Within
from robosim.verification.cases.record import Record, TimedSolver

NAME = "orifice"
SOURCE = ("Q = C sqrt(g) D^(3/2) per thickness (Beverloo et al. 1961 in a plane); C = 1.50 of the mu(I) continuum, "
          "Staron, Lagree & Popinet 2012, Phys. Fluids 24:103301, by the fit distributed with Basilisk")
BANDS = {"prefactor": 0.30, "steadiness": 0.05, "least exponent": 1.4, "most exponent": 1.6}
"""Relative error of C; relative change of the rate from the first half to the second, after a quarter of the time;
power of the free width."""
SWEEP = [{"orifice_cells": d, "courant": c} for c in (0.3, 0.6) for d in (7, 9, 13)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"orifice_cells": d, "courant": 0.6} for d in (9, 13)]
MAIN_ERROR, RESOLUTION = "prefactor", "orifice_cells"
CLAIMS = (Within("prefactor", BANDS["prefactor"]), Within("steadiness", BANDS["steadiness"]),
          *(Power("rate", "free_width", BANDS["least exponent"], BANDS["most exponent"], {"courant": c})
            for c in (0.3, 0.6)))
CELL, HALF, HEIGHT, FALL = 0.0025, 0.10, 0.20, 0.15
"""[m]: cell, half of the silo's width, height of the fill above the floor, room below it."""
DENSITY, NU, G, E, PHI_DEG = 1500.0, 0.3, 9.81, 1e5, 25.377
"""The angle with which the cone of triaxial compression carries tan 30 deg in simple shear."""
CLOGGED = 1.0
"""Cells by which the floor's two edges narrow the slot: half a cell each."""
C = 1.504


def measure(*, orifice_cells: int = 13, courant: float = 0.6, precision: str = "f32", E: float = E) -> Record:
    """Run the case; return the errors of the discharge's prefactor and steadiness.

    orifice_cells: width of the slot; E: Young's modulus [Pa].
    """
    half_slot = 0.5 * orifice_cells * CELL
    sand = mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=PHI_DEG)
    positions = mpm.sample_box((0, 0, FALL), (HALF, CELL, FALL + HEIGHT), CELL / 2, np.random.default_rng(0))
    volume = HALF * CELL * HEIGHT / len(positions)
    thick, reach = 4 * CELL, HALF  # the floor goes on beyond the silo's wall
    floor = mpm.Collider(
        mpm.Sdf.box(((HALF + reach - half_slot) / 2, 4 * CELL, thick / 2)), static=True, friction=0.5,
        pose=mpm.Pose(np.array([(HALF + reach + half_slot) / 2, CELL / 2, FALL - thick / 2]),
                      mpm.Pose.identity().quaternion))
    walls = mpm.Walls(lower=("roller", "periodic", "friction"), upper=("slip", "periodic", "slip"))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (HALF, CELL, FALL + HEIGHT + 2 * CELL), CELL), colliders=[floor], walls=walls,
        bodies=[mpm.Body(sand, positions, volume=volume)], precision=precision,
        dt=courant * CELL / math.sqrt((sand.lam + 2 * sand.mu) / DENSITY))
    timed, times, passed = TimedSolver(solver), [0.0], [0.0]
    share = 0.0
    while share < 0.4 and solver.time < 4.0:
        timed.advance(5e-3)
        share = float(np.mean(solver.positions()[:, 2] < FALL - thick))
        times.append(solver.time)
        passed.append(share * len(positions) * volume / CELL)
    t, area = np.array(times), np.array(passed)
    steady = t > 0.25 * t[-1]
    rate = 2.0 * np.polyfit(t[steady], area[steady], 1)[0]
    parts = [(t > a * t[-1]) & (t <= b * t[-1]) for a, b in ((0.25, 0.6), (0.6, 0.95))]
    early, late = (np.polyfit(t[p], area[p], 1)[0] for p in parts)
    width = (orifice_cells - CLOGGED) * CELL
    errors = {"prefactor": rate / (C * math.sqrt(G) * width**1.5) - 1,
              "steadiness": late / early - 1 if early > 0 else np.nan}  # nothing runs out of a slot that clogs
    choices = {"orifice_cells": orifice_cells, "courant": courant, "precision": precision, "E": E}
    return timed.record(NAME, choices, errors, rate=rate, free_width=width, emptied=share, time=t[-1])

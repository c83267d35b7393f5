"""Discharge of sand from a slot in a flat floor.

Measured: relative error of the discharge's prefactor, relative change of its rate in time, and its power of the free
width. Reference: Q = C sqrt(g) D^(3/2) per thickness, independent of the height of the fill; that of a fluid would
fall. C depends on friction; that of the reference is the law "mu_i". How much of its width a slot loses at its edges is
not known beforehand: the root, (Q / sqrt(g))^(2/3), is a straight line over the width, with the slope C^(2/3).

Half of the silo is computed, one cell thick. The slot is an odd number of cells wide, so that its edges lie midway
between nodes: a wall begins at the first node in it.
"""

import math

import numpy as np

import mpm
from robosim.base.errors import UnknownName
from robosim.studies.verification.cases.beds import UPRIGHT, courant_step
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Power, Slope, Within

C = 1.504
CELL, HALF, HEIGHT, FALL = 0.0025, 0.10, 0.20, 0.15
"""[m]: cell, half of the silo's width, height of the fill above the floor, room below it."""
DENSITY, NU, G, E, PHI_DEG = 1500.0, 0.3, 9.81, 1e5, 25.377
"""The angle with which the cone of triaxial compression carries tan 30 deg in simple shear."""
_USUAL = {"E": E, "floor_friction": 0.5, "floor_cells": 4, "strides": True}
CLOGGED = 1.0
"""Cells by which the floor's two edges narrow the slot: half a cell each."""
LAWS = ("drucker_prager", "slow", "mu_i")
"""tan 30 deg in simple shear; the friction of the reference's law in slow flow; that law itself."""
SLOW, FAST, I0, GRAIN = 0.32, 0.60, 0.4, 1e-3
"""The reference's ratios of shear stress to pressure at rest and at infinite rate, and inertial number between them,
with the density of the bulk, as distributed with Basilisk (granular.h); diameter of a grain [m], of which the
reference's slots are 9 to 36 wide."""


def make_sand(law: str, E: float) -> mpm.DruckerPrager:
    """Return a law. Raises UnknownName for one that is not in LAWS."""
    if law not in LAWS:
        raise UnknownName("law", law, LAWS)
    if law == "drucker_prager":
        return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=PHI_DEG)
    slow, fast = (math.degrees(math.asin(ratio)) for ratio in (SLOW, FAST))
    if law == "slow":
        return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=slow, cone="plane_strain")
    return mpm.MuIRheology(E=E, nu=NU, density=DENSITY, friction_angle_deg=slow, limit_angle_deg=fast,
                           cone="plane_strain", grain_diameter=GRAIN, grain_density=DENSITY, inertial_number=I0)


@case(
    source="Q = C sqrt(g) D^(3/2) per thickness (Beverloo et al. 1961 in a plane); C = 1.50 of the mu(I) continuum, "
           "Staron, Lagree & Popinet 2012, Phys. Fluids 24:103301, by the fit distributed with Basilisk",
    sweep=[*grid(courant=(0.3, 0.6), orifice_cells=(7, 9, 13)), *grid(orifice_cells=(7, 9, 13), law=("mu_i",)),
           {"law": "slow"}, *({"law": "mu_i", **choice} for choice in (
               {"strides": False}, {"E": 4e5}, {"floor_friction": 1.0}, {"floor_cells": 2}))],
    quick=grid(orifice_cells=(9, 13), law=("mu_i",)),
    # the prefactor with any friction, and with that of the reference; change of the rate from the first half to the
    # second, after a quarter of the time; the slope of the root is that of C within 0.1
    expectations=(Within("prefactor", 0.30), Within("prefactor", 0.10, {"law": "mu_i"}), Within("steadiness", 0.05),
                  *(Power("rate", "free_width", 1.4, 1.6, {**_USUAL, "courant": c, "law": law})
                    for c, law in ((0.3, "drucker_prager"), (0.6, "drucker_prager"), (0.6, "mu_i"))),
                  Slope("root", "slot", (0.9 * C) ** (2 / 3), (1.1 * C) ** (2 / 3), {**_USUAL, "law": "mu_i"})),
    main_error="prefactor", resolution="orifice_cells")
def measure(*, orifice_cells: int = 13, courant: float = 0.6, precision: str = "f32", E: float = E,
            law: str = LAWS[0], floor_friction: float = 0.5, floor_cells: int = 4, strides: bool = True) -> Record:
    """Run the case; return the errors of the discharge's prefactor and steadiness.

    orifice_cells: width of the slot; E: Young's modulus [Pa]; law: one of LAWS; floor_friction: coefficient;
    floor_cells: its thickness.
    """
    half_slot = 0.5 * orifice_cells * CELL
    sand = make_sand(law, E)
    positions = mpm.sample_box((0, 0, FALL), (HALF, CELL, FALL + HEIGHT), CELL / 2, np.random.default_rng(0))
    volume = HALF * CELL * HEIGHT / len(positions)
    thick, reach = floor_cells * CELL, HALF  # the floor goes on beyond the silo's wall
    floor = mpm.Collider(
        mpm.Sdf.box(((HALF + reach - half_slot) / 2, 4 * CELL, thick / 2)), static=True, friction=floor_friction,
        pose=mpm.Pose(np.array([(HALF + reach + half_slot) / 2, CELL / 2, FALL - thick / 2]), UPRIGHT))
    walls = mpm.Walls(lower=("roller", "periodic", "friction"), upper=("slip", "periodic", "slip"))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (HALF, CELL, FALL + HEIGHT + 2 * CELL), CELL), colliders=[floor], walls=walls,
        bodies=[mpm.Body(sand, positions, volume=volume)], precision=precision,
        transfer_interval=None if strides else 0.0,
        dt=courant_step(courant, CELL, sand))
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
    return timed.record(errors, rate=rate, free_width=width, slot=orifice_cells * CELL,
                        root=(rate / math.sqrt(G)) ** (2 / 3), emptied=share, time=t[-1])

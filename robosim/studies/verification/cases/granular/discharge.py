"""Discharge of sand from a slot, and of salt from holes that the cells do not resolve."""

import math

import numpy as np
import trimesh

import mpm
from robosim.base.errors import UnknownName
from robosim.studies.verification.cases.beds import UPRIGHT, courant_step, set_up
from robosim.studies.verification.cases.case import Record, case, grid
from robosim.studies.verification.cases.expectations import Power, Slope, Within, each_within

C, G = 1.504, 9.81
CELL, HALF, HEIGHT, FALL = 0.0025, 0.10, 0.20, 0.15
"""[m]: cell, half of the silo's width, height of the fill above the floor, room below it."""
DENSITY, NU, E, PHI_DEG = 1500.0, 0.3, 1e5, 25.377
"""The angle with which the cone of triaxial compression carries tan 30 deg in simple shear."""
_USUAL = {"E": E, "floor_friction": 0.5, "floor_cells": 4, "strides": True}
LAWS = ("drucker_prager", "slow", "mu_i")
"""tan 30 deg in simple shear; the friction of the reference's law in slow flow; that law itself."""
SLOW, FAST, I0, GRAIN = 0.32, 0.60, 0.4, 1e-3
"""The reference's ratios of shear stress to pressure at rest and at infinite rate, and inertial number between them,
with the density of the bulk, as distributed with Basilisk (granular.h); diameter of a grain [m], of which the
reference's slots are 9 to 36 wide."""
CAN, DEEP, FILL, BELOW = 0.024, 0.05, 0.04, 0.05
"""Half the can's width, its depth, height of the fill, room below it [m]."""
PLACES = 0.011 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
"""Where the holes are [m]."""
THICKNESS, SALT, PER_CELL = 1.5e-3, 1217.0, 8
"""SALT: density [kg/m^3]."""
HOLE_C, K = 0.58, 1.4


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
def orifice(*, orifice_cells: int = 13, courant: float = 0.6, precision: str = "f32", E: float = E,
            law: str = LAWS[0], floor_friction: float = 0.5, floor_cells: int = 4, strides: bool = True) -> Record:
    """Discharge of sand from a slot in a flat floor.

    Measured: relative error of the discharge's prefactor, relative change of its rate in time, and its power of the
    free width. The reference is independent of the height of the fill; the discharge of a fluid would fall. C depends
    on friction; that of the reference is the law "mu_i". How much of its width a slot loses at its edges is not known
    beforehand: the root, (Q / sqrt(g))^(2/3), is a straight line over the width, with the slope C^(2/3).

    Half of the silo is computed, one cell thick. The slot is an odd number of cells wide, so that its edges lie midway
    between nodes: a wall begins at the first node in it. law: one of LAWS; floor_friction: coefficient; floor_cells:
    its thickness."""
    half_slot, thick = 0.5 * orifice_cells * CELL, floor_cells * CELL
    sand = make_sand(law, E)
    positions = mpm.sample_box((0, 0, FALL), (HALF, CELL, FALL + HEIGHT), CELL / 2, np.random.default_rng(0))
    volume, reach = HALF * CELL * HEIGHT / len(positions), HALF  # the floor goes on beyond the silo's wall
    floor = mpm.Collider(
        mpm.Sdf.box(((HALF + reach - half_slot) / 2, 4 * CELL, thick / 2)), static=True, friction=floor_friction,
        pose=mpm.Pose(np.array([(HALF + reach + half_slot) / 2, CELL / 2, FALL - thick / 2]), UPRIGHT))
    walls = mpm.Walls(lower=("roller", "periodic", "friction"), upper=("slip", "periodic", "slip"))
    timed, solver = set_up(mpm.Body(sand, positions, volume=volume), (HALF, CELL, FALL + HEIGHT + 2 * CELL), CELL,
                           colliders=[floor], walls=walls, precision=precision,
                           transfer_interval=None if strides else 0.0, dt=courant_step(courant, CELL, sand))
    times, passed, share = [0.0], [0.0], 0.0
    while share < 0.4 and solver.time < 4.0:
        timed.advance(5e-3)
        share = float(np.mean(solver.positions()[:, 2] < FALL - thick))
        times.append(solver.time)
        passed.append(share * len(positions) * volume / CELL)
    t, area = np.array(times), np.array(passed)

    def mean_rate(begin: float, end: float = 1.0) -> float:
        """Return the slope of the area that has passed, between two shares of the time."""
        part = (t > begin * t[-1]) & (t <= end * t[-1])
        return np.polyfit(t[part], area[part], 1)[0]

    rate, early, late = 2.0 * mean_rate(0.25), mean_rate(0.25, 0.6), mean_rate(0.6, 0.95)
    width = (orifice_cells - 1.0) * CELL  # the floor's edges narrow the slot by half a cell each
    errors = {"prefactor": rate / (C * math.sqrt(G) * width**1.5) - 1,
              "steadiness": late / early - 1 if early > 0 else np.nan}  # nothing runs out of a slot that clogs
    return timed.record(errors, rate=rate, free_width=width, slot=orifice_cells * CELL,
                        root=(rate / math.sqrt(G)) ** (2 / 3), emptied=share, time=t[-1])


@case(
    source="Beverloo, Leniger & van de Velde 1961, Chem. Eng. Sci. 15:260: W = C rho sqrt(g) (D - k d)^(5/2), "
           "C = 0.58, k = 1.4; nothing below D / d = 4",
    sweep=grid(cell=(0.008, 0.006, 0.004), ratio=(3.0, 3.9, 6.0, 8.0, 12.0, 20.0)),
    quick=[{"ratio": r, "cell": c} for r, c in ((3.9, 0.008), (6.0, 0.008), (20.0, 0.006))],
    # the rate for D / d of 6 to 20; share of the law without cut-off that passes below 4; unaccounted share of the
    # momentum exchanged with the can, the larger of the linear and the angular one
    expectations=each_within({"rate": 0.15, "blocked": 0.0, "momentum": 1e-6}), main_error="rate")
def small_hole(*, ratio: float = 8.0, cell: float = 0.006, diameter: float = 3e-3, duration: float = 2.0,
               precision: str = "f32") -> Record:
    """Discharge of salt from holes of 3 mm in the floor of a thin can, on cells of 4 to 8 mm.

    Measured: relative error of the mass below the floor; of holes too small for the grains, that mass as a share of
    what the law without cut-off gives; the part of the momentum that gravity, walls and can do not account for.
    `mpm.Orifice` imposes the law: what the case tests is that the bed keeps the holes covered on every cell, that what
    passes arrives below, and that momentum is kept although particles are carried through the floor. ratio: D / d;
    diameter: of the holes [m]; duration: of the discharge [s]."""
    spacing = cell / PER_CELL ** (1 / 3)
    salt = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=SALT, friction_angle_deg=33.0)
    margin = 0.5 * (THICKNESS + spacing)
    grains = mpm.sample_box((margin - CAN, margin - CAN, margin), (CAN - margin, CAN - margin, FILL), spacing,
                            np.random.default_rng(0))
    place = np.array([2 * CAN, 2 * CAN, BELOW])
    box = trimesh.creation.box((2 * CAN, 2 * CAN, DEEP))
    box.apply_translation((0.0, 0.0, 0.5 * DEEP))
    can = trimesh.Trimesh(box.vertices, box.faces[box.triangles_center[:, 2] < DEEP - 1e-6])  # open on top
    holes = mpm.Orifice(PLACES, np.array([0.0, 0.0, -1.0]), diameter=diameter, grain_diameter=diameter / ratio, k=K,
                        C=HOLE_C)
    holder = mpm.Collider(mpm.Shell.from_mesh(can, THICKNESS), friction=0.3, orifices=[holes],
                          pose=mpm.Pose(place, UPRIGHT))
    timed, solver = set_up(mpm.Body(salt, grains + place, volume=spacing**3), (4 * CAN, 4 * CAN, BELOW + DEEP + cell),
                           cell, colliders=[holder], precision=precision, gravity=(0, 0, -G))
    mass = float(solver.masses()[0])

    def mass_below() -> float:
        return mass * float(np.count_nonzero(solver.positions()[:, 2] < BELOW))

    def lawful(width: float) -> float:
        return len(PLACES) * HOLE_C * SALT * math.sqrt(G) * width**2.5 * duration

    timed.advance(0.2)  # the bed settles, with the holes already open, and the rate becomes steady
    begin, momentum = mass_below(), np.concatenate(solver.momentum())
    given, exchanged = np.zeros(6), np.zeros(2)
    for _ in range(round(duration / 0.05)):
        timed.advance(0.05)
        given += solver.ledger.sum(0)
        impulse = solver.collider_impulse(0, np.zeros(3))
        exchanged += np.linalg.norm([impulse.force, impulse.torque], axis=1)
    passed, law = mass_below() - begin, lawful(diameter - K * diameter / ratio)
    left = np.concatenate(solver.momentum()) - momentum - given
    errors = {"momentum": float((np.abs(left.reshape(2, 3)).max(1) / exchanged).max())}
    errors |= {"blocked": passed / lawful(diameter)} if ratio < 4.0 else {"rate": passed / law - 1}
    return timed.record(errors, passed_g=1e3 * passed, law_g=1e3 * law, particle_g=1e3 * mass)

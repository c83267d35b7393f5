"""Collapse of a round column of sand over a floor."""

import math
from dataclasses import dataclass

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import courant_step, fill_column, rim, rms
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within

ROUND = {"a": 1.0, "cells": 12, "cone": "compression", "strides": True}
RADIUS, DENSITY, NU, G = 0.1, 1600.0, 0.3, 9.81
ANGLES_DEG = {"compression": 25.377, "plane_strain": 35.264}
"""Friction angle with which either cone carries tan 30 deg in simple shear."""


def crest(a: float) -> float:
    """Return the height [m] of the deposit; the fit for tall columns fills the source's gap from a = 1 to 1.7."""
    return RADIUS * (a if a < 1 else 0.88 * a ** (1 / 6))


@dataclass(frozen=True)
class Column:
    """Choices of a run."""

    a: float = 1.0
    """Height over radius."""
    cells: float = 20
    """Per radius."""
    per_cell: int = 4
    """Particles, see `fill_column`."""
    E: float = 2e4
    """Young's modulus [Pa] for a = 1. It grows with a, so that columns of all heights are compressed alike, by 3 % on
    average at 2e4. The rim is the same to some 1 % for half or one and a half times that; the height is not: soft or
    coarse columns sag at the axis."""
    courant: float = 0.55
    precision: str = "f32"
    quarter: bool = True
    duration: float | None = None
    """[s]; None: twice the source's time."""
    cone: str = "compression"
    strides: bool = True


def build_column(column: Column, sleep: bool | float = False) -> mpm.Solver:
    """Build the column before its release, about the z axis."""
    a, cell, cone = column.a, RADIUS / column.cells, column.cone
    sand = mpm.DruckerPrager(E=column.E * a, nu=NU, density=DENSITY, friction_angle_deg=ANGLES_DEG[cone], cone=cone)
    grains = fill_column(RADIUS, a * RADIUS, cell, np.random.default_rng(0), per_cell=column.per_cell,
                         quarter=column.quarter)
    volume = math.pi * RADIUS**2 * a * RADIUS / (4 if column.quarter else 1) / len(grains)
    room = math.ceil(1.5 * rim(RADIUS, a) / cell) * cell
    near = 0.0 if column.quarter else -room
    side = "roller" if column.quarter else "friction"
    return mpm.Solver(
        grid=mpm.Grid((near, near, 0), (room, room, 1.2 * a * RADIUS + 2 * cell), cell),
        walls=mpm.Walls(friction=0.5, lower=(side, side, "friction")),
        bodies=[mpm.Body(sand, grains, volume=volume)], gravity=(0, 0, -G), precision=column.precision, sleep=sleep,
        transfer_interval=None if column.strides else 0.0, dt=courant_step(column.courant, cell, sand))


def measure_deposit(solver: mpm.Solver) -> tuple[float, float]:
    """Return the radius [m] that holds 99 % of the particles, and the height [m] at the axis."""
    positions = solver.positions()
    radii = np.hypot(*positions[:, :2].T)
    height = np.quantile(positions[radii < 0.2 * RADIUS, 2], 0.99)
    return float(np.quantile(radii, 0.99)), float(height)


@case(
    source="Lube et al. 2004, J. Fluid Mech. 508:175: r = r0 (1 + 1.24 a) for a < 1.7, r0 (1 + 1.6 sqrt(a)) above; "
           "h = r0 a for a < 1, 0.88 r0 a^(1/6) from 1.7; at rest after 3 sqrt(h0 / g)",
    # transfers are a drag: without strides, the column runs out less with every halving of the step
    sweep=[*grid(quarter=(True, False), cells=(8, 12, 16, 20)), {"a": 3.0, "cells": 12},
           *grid(cells=(8, 12, 16, 20), cone=("plane_strain",)), *grid(cells=(12,), courant=(0.1, 0.2, 0.4)),
           *grid(cells=(8, 12, 16, 20), strides=(False,)),
           *grid(cells=(12,), courant=(0.1, 0.2, 0.4), strides=(False,))],
    quick=[*grid(cells=(6, 8, 12, 16)), {"cells": 12, "cone": "plane_strain"}],
    # run_out: (r99 - r0) / r0; drift: rms velocity at the end
    expectations=(Within("run_out", 1.5, ROUND, 0.85), Within("rim", 0.012, ROUND),
                  Within("run-out", 0.35, {"a": 3.0}), Within("drift", 0.005, {"a": 3.0})),
    main_error="rim", resolution="cells", units={"drift": "m/s"}, options=Column)
def column_collapse(column: Column) -> Record:
    """Collapse of a round column of sand over a floor.

    Measured: relative errors of the deposit's rim, run-out and height, and the rms velocity at the end. The radius that
    holds 99 % of the particles stands for the rim. quarter: of the column, between two planes of symmetry."""
    a, solver = column.a, build_column(column)
    timed = TimedSolver(solver)
    timed.advance(column.duration or 0.6 * math.sqrt(a))
    r99, height = measure_deposit(solver)
    expected = rim(RADIUS, a)
    errors = {"rim": r99 / expected - 1, "run-out": (r99 - RADIUS) / (expected - RADIUS) - 1,
              "height": height / crest(a) - 1, "drift": rms(solver.velocities())}
    return timed.record(errors, r99=r99, run_out=(r99 - RADIUS) / RADIUS, crest=height)

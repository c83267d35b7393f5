"""Heap with a straight slope, below and above the steepest one that friction bears.

Measured: change of the slope [deg], and its difference [deg] from the limit. Reference: limit equilibrium in plane
strain, in which a slope without cohesion stands up to atan(m3) (see `slope`). Inertia carries a slumping heap some
degrees below the limit. Half of the heap is computed, one cell thick.
"""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import courant_step
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.granular.slope import shear_ratio

BASE, DENSITY, NU, E, FLOOR_FRICTION = 0.2, 1500.0, 0.3, 1e5, 1.0
"""A floor that sticks would pin the toe: at 16 cells a heap of 43 deg then stands."""


@case(
    source="limit equilibrium of a slope without cohesion: it stands up to atan(m3)",
    sweep=grid(phi_deg=(20.0, 25.0, 30.0), beyond_deg=(-3.0, 8.0), cells=(16, 32)),
    quick=grid(phi_deg=(25.0,), beyond_deg=(-3.0, 8.0), cells=(16,)),
    expectations=(Within("change", 2.0, {"beyond_deg": -3.0}), Within("excess", 1.0, {"beyond_deg": 8.0}, -8.0)),
    main_error="excess", resolution="cells", units={"change": "deg", "excess": "deg"})
def measure(*, phi_deg: float = 25.0, beyond_deg: float = -3.0, cells: int = 32, courant: float = 0.5,
            precision: str = "f32", duration: float = 1.5, cone: str = "compression") -> Record:
    """Run the case; return the slope's change and its excess over the limit [deg].

    beyond_deg: of the initial slope beyond the limit. cells: over the height. duration [s].
    """
    sand = mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi_deg, cone=cone)
    limit = math.degrees(math.atan(shear_ratio(phi_deg, cone)))
    begin = limit + beyond_deg
    height = BASE * math.tan(math.radians(begin))
    cell = height / cells
    room = math.ceil(2.2 * BASE / cell) * cell
    positions = mpm.sample_box((0, 0, 0), (BASE, cell, height), cell / 2)
    positions = positions[positions[:, 2] < (BASE - positions[:, 0]) * height / BASE]
    walls = mpm.Walls(friction=FLOOR_FRICTION, lower=("roller", "periodic", "friction"),
                      upper=("slip", "periodic", "slip"))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (room, cell, 1.2 * height), cell), walls=walls, precision=precision,
        bodies=[mpm.Body(sand, positions, volume=0.5 * BASE * height * cell / len(positions))],
        dt=courant_step(courant, cell, sand))
    timed = TimedSolver(solver)
    timed.advance(duration)
    end = surface_slope(solver.positions(), cell)
    speed = np.sqrt((solver.velocities() ** 2).sum(1).mean())
    return timed.record({"change": end - begin, "excess": end - limit}, limit=limit, begin=begin,
                        slope=end, speed=speed)


def surface_slope(positions: np.ndarray, cell: float) -> float:
    """Return the surface's angle [deg] between a fifth and four fifths of the heap's height."""
    columns = np.floor(positions[:, 0] / cell).astype(int)
    tops = np.full(columns.max() + 1, np.nan)
    for k in range(len(tops)):
        here = positions[columns == k, 2]
        if len(here):
            tops[k] = here.max()
    x = (np.arange(len(tops)) + 0.5) * cell
    inner = (tops > 0.2 * np.nanmax(tops)) & (tops < 0.8 * np.nanmax(tops))
    return -math.degrees(math.atan(np.polyfit(x[inner], tops[inner], 1)[0]))

"""Spin of a free elastic block about a slanted axis.

Measured: change of linear and angular momentum over the run, relative to the angular momentum; the affine part of the
particles' velocities counts. Reference: conservation.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "spin"
SOURCE = "conservation; Jiang et al. 2017, J. Comput. Phys. 338:137 for the affine part of the angular momentum"
BANDS = {"f64": 1e-12, "f32": 1e-5}
"""Largest drift of linear and angular momentum, relative to the angular momentum, by precision."""
SWEEP = [{"precision": p, "courant": c} for p in ("f32", "f64") for c in (0.2, 0.5)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"precision": p, "courant": 0.2} for p in ("f64", "f32")]
MAIN_ERROR, RESOLUTION = "angular", None
CLAIMS = tuple(Within(name, BANDS[p], {"precision": p}) for p in ("f64", "f32") for name in ("linear", "angular"))


def measure(*, precision: str = "f64", courant: float = 0.3, steps: int = 1000) -> Record:
    """Run the case; return the changes of linear [1/m] and angular momentum, relative to the latter."""
    cell, spin, centre = 1 / 24, np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.5, 0.5])
    positions = mpm.sample_box(centre - 0.2, centre + 0.2, cell / 2)
    material = mpm.Elastic(E=1e4, nu=0.3, density=1000.0)
    body = mpm.Body(material, positions, volume=(cell / 2) ** 3, velocities=np.cross(spin, positions - centre))
    dt = courant * cell / np.sqrt((material.lam + 2 * material.mu) / material.density)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), cell), bodies=[body], gravity=(0, 0, 0), dt=dt,
                        precision=precision)
    timed = TimedSolver(solver)
    timed.advance(dt)  # the affine part is there from the first gather on
    before, energy = solver.momentum(), solver.energy()
    timed.advance(steps * dt)
    after = solver.momentum()
    scale = np.abs(before.angular).max()
    errors = {"linear": np.abs(after.linear - before.linear).max() / scale,
              "angular": np.abs(after.angular - before.angular).max() / scale}
    return timed.record(NAME, {"precision": precision, "courant": courant}, errors,
                        energy_ratio=sum(solver.energy()) / sum(energy))

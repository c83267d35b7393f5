"""Spin of a free elastic block about a slanted axis.

Measured: change of linear and angular momentum over the run, relative to the angular momentum; the affine part of the
particles' velocities counts. Reference: conservation.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import courant_step
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within


@case(
    source="conservation; Jiang et al. 2017, J. Comput. Phys. 338:137 for the affine part of the angular momentum",
    sweep=grid(precision=("f32", "f64"), courant=(0.2, 0.5)),
    quick=grid(precision=("f64", "f32"), courant=(0.2,)),
    expectations=[Within(name, high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 1e-5))
                  for name in ("linear", "angular")],
    main_error="angular")
def measure(*, precision: str = "f64", courant: float = 0.3, steps: int = 1000) -> Record:
    """Run the case; return the changes of linear [1/m] and angular momentum, relative to the latter."""
    cell, spin, centre = 1 / 24, np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.5, 0.5])
    positions = mpm.sample_box(centre - 0.2, centre + 0.2, cell / 2)
    material = mpm.Elastic(E=1e4, nu=0.3, density=1000.0)
    body = mpm.Body(material, positions, volume=(cell / 2) ** 3, velocities=np.cross(spin, positions - centre))
    dt = courant_step(courant, cell, material)
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
    return timed.record(errors, energy_ratio=sum(solver.energy()) / sum(energy))

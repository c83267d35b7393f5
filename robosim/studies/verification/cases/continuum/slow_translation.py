"""Slow translation of a block of grains, a metre from the origin.

Measured: relative errors of the mean displacement along each axis; the largest counts. Reference: v t. A substep's
displacement, 2e-9 m, is far below what single precision resolves there, 1.2e-7 m: a position to which it is added as it
is stays where it is.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within


@case(
    source="x = x0 + v t, as without forces",
    sweep=grid(precision=("f32", "f64"), strides=(True, False)),
    quick=grid(precision=("f32", "f64"), strides=(True, False)),
    # 0.03 is half of what is resolved at 1 m, over 4 micrometres and more
    expectations=[Within("displacement", high, {"precision": p}) for p, high in (("f64", 1e-5), ("f32", 0.03))],
    main_error="displacement")
def measure(*, precision: str = "f32", speed: float = 1e-5, steps: int = 4000, dt: float = 2e-4,
            strides: bool = True) -> Record:
    """Run the case; return the relative error of the displacement. speed [m/s] along each axis."""
    cell = 0.02
    start = mpm.sample_box((0.9,) * 3, (0.9 + 3 * cell,) * 3, cell / 2, np.random.default_rng(0))
    sand = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
    body = mpm.Body(sand, start, np.full(start.shape, speed), volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1.2, 1.2, 1.2), cell), bodies=[body], gravity=(0, 0, 0), dt=dt,
                        precision=precision, transfer_interval=None if strides else 0.0)
    timed = TimedSolver(solver)
    timed.advance(steps * dt)
    moved = (solver.positions() - start).mean(0)
    return timed.record({"displacement": np.abs(moved / (speed * steps * dt) - 1.0).max()})

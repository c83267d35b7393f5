"""Free fall of an elastic block.

Measured: the largest error [m] of a particle's position. Reference: x = x0 + v n dt + g dt^2 n (n + 1) / 2, the
trajectory of symplectic Euler, which holds for any partition of unity, whatever the grid's place and the block's speed.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within

G = 9.81


@case(
    source="x = x0 + v n dt + g dt^2 n (n + 1) / 2, exact for symplectic Euler and for any partition of unity",
    sweep=grid(precision=("f32", "f64"), strides=(True, False)),
    quick=grid(precision=("f32", "f64"), strides=(True, False)),
    expectations=[Within("max", high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 1e-6))],
    main_error="max", units={"max": "m"})
def measure(*, precision: str = "f64", speed: float = 0.0, steps: int = 150, dt: float = 1e-3,
            strides: bool = True) -> Record:
    """Run the case; return the largest and rms error [m] of a position. speed [m/s] along x."""
    cell = 0.05
    low = np.array([0.301, 0.301, 0.601])
    start = mpm.sample_box(low, low + 4 * cell, cell / 2)
    velocity = np.array([speed, 0.0, 0.0])
    body = mpm.Body(mpm.Elastic(E=1e5, nu=0.3, density=1000.0), start, volume=(cell / 2) ** 3,
                    velocities=np.tile(velocity, (len(start), 1)))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1.6, 1, 1), cell), bodies=[body], dt=dt, precision=precision,
                        transfer_interval=None if strides else 0.0)
    timed = TimedSolver(solver)
    timed.advance(steps * dt)
    expected = start + velocity * steps * dt + np.array([0, 0, -G]) * dt**2 * steps * (steps + 1) / 2
    error = np.abs(solver.positions() - expected)
    return timed.record({"rms": np.sqrt((error**2).mean()), "max": error.max()})

"""Free fall of an elastic block.

Measured: the largest error [m] of a particle's position. Reference: x = x0 + v n dt + g dt^2 n (n + 1) / 2, the
trajectory of symplectic Euler, which holds for any partition of unity, whatever the grid's place and the block's speed.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "free_fall"
SOURCE = "x = x0 + v n dt + g dt^2 n (n + 1) / 2, exact for symplectic Euler and for any partition of unity"
BANDS = {"f64": 1e-12, "f32": 1e-6, "f32, fast": 3e-6}
"""Largest error of a position [m], by precision. Fast: 5 m/s are rounded by up to 2.4e-7 m/s in each of 150 transfers.
Always to the same side, that is 2.7e-6 m in 0.15 s. Positions themselves add 1.2e-7 m at most."""
SWEEP = [{"precision": p, "strides": s} for p in ("f32", "f64") for s in (True, False)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP, MAIN_ERROR, RESOLUTION = SWEEP, "max", None
CLAIMS = tuple(Within("max", BANDS[p], {"precision": p}) for p in ("f64", "f32"))
G = 9.81


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
    return timed.record(NAME, {"precision": precision, "speed": speed, "dt": dt, "strides": strides},
                        {"rms": np.sqrt((error**2).mean()), "max": error.max()})

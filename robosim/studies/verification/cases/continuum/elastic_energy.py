"""Free vibration of an elastic block, for each elastic law.

Measured: rise of the total energy, kinetic and elastic, above its start and after any moment, its trend, and the loss
per period. Reference: the first law of thermodynamics; the energies of the laws are evaluated in closed form.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import courant_step
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within

LAWS = ("hencky", "neo_hookean", "fixed_corotated")
SIDE, E, NU, DENSITY, RATE = 0.1, 1e5, 0.3, 1000.0, 20.0
"""RATE [1/s]: the block begins to stretch along x and to shrink across, by some 15 % at the most."""
PERIOD = 2.0 * SIDE / np.sqrt(E / DENSITY)
"""[s] of a wave along the block and back."""


@case(
    source="first law of thermodynamics for a hyperelastic body; energies of the three laws in closed form",
    sweep=grid(model=LAWS, courant=(0.1, 0.2, 0.3), strides=(True, False)),
    quick=grid(model=LAWS, courant=(0.3,)),
    # most that the energy rises above its start, and from any moment to a later one, as shares of the first (a stored
    # energy that is a tenth wrong swings by a tenth); that its trend over all periods gains, and that a period takes
    expectations=each_within({"growth": 0.02, "slope": 0.0, "rise": 0.05, "lost per period": 0.2}, low=-np.inf),
    main_error="lost per period", resolution="courant")
def measure(*, model: str = "hencky", cells: int = 12, courant: float = 0.3, precision: str = "f32",
            strides: bool = True, periods: int = 10) -> Record:
    """Run the case; return the energy's rise, trend and loss per period. cells: along a side."""
    cell = SIDE / cells
    law = mpm.Elastic(E=E, nu=NU, density=DENSITY, model=model)
    room, centre = 2.0 * SIDE, np.full(3, SIDE)
    positions = mpm.sample_box(centre - SIDE / 2, centre + SIDE / 2, cell / 2)
    velocities = RATE * (positions - centre) * (1.0, -NU, -NU)
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (room, room, room), cell), gravity=(0, 0, 0), precision=precision,
        bodies=[mpm.Body(law, positions, volume=SIDE**3 / len(positions), velocities=velocities)],
        transfer_interval=None if strides else 0.0, dt=courant_step(courant, cell, law))
    timed = TimedSolver(solver)
    times, energies = [0.0], [sum(solver.energy())]
    timed.advance(solver.dt)  # the affine part is there from the first gather on
    energies[0] = sum(solver.energy())
    for _ in range(40 * periods):
        timed.advance(PERIOD / 40)
        times.append(solver.time / PERIOD)
        energies.append(sum(solver.energy()))
    share = np.array(energies) / energies[0]
    trend = np.polyfit(times, share, 1)[0]
    rise = (share - np.minimum.accumulate(share)).max()
    return timed.record({"growth": share.max() - 1, "slope": trend, "rise": rise,
                                        "lost per period": 1 - share[-1] ** (1 / periods)}, energy_left=share[-1])

"""Free vibration of an elastic block, for each elastic law.

Measured: rise of the total energy, kinetic and elastic, above its start and after any moment, its trend, and the loss
per period. Reference: the first law of thermodynamics; the energies of the laws are evaluated in closed form.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "elastic_energy"
SOURCE = "first law of thermodynamics for a hyperelastic body; energies of the three laws in closed form"
BANDS = {"growth": 0.02, "slope": 0.0, "rise": 0.05, "lost per period": 0.2}
"""Most that the energy rises above its start, and from any moment to a later one, as shares of the first (a stored
energy that is a tenth wrong swings by a tenth); most that its trend over all periods gains, and that a period takes."""
LAWS = ("hencky", "neo_hookean", "fixed_corotated")
SWEEP = [{"model": m, "courant": c, "strides": s} for m in LAWS for c in (0.1, 0.2, 0.3) for s in (True, False)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"model": m, "courant": 0.3} for m in LAWS]
MAIN_ERROR, RESOLUTION = "lost per period", "courant"
CLAIMS = tuple(Within(name, bound, low=-np.inf) for name, bound in BANDS.items())
SIDE, E, NU, DENSITY, RATE = 0.1, 1e5, 0.3, 1000.0, 20.0
"""RATE [1/s]: the block begins to stretch along x and to shrink across, by some 15 % at the most."""
PERIOD = 2.0 * SIDE / np.sqrt(E / DENSITY)
"""[s] of a wave along the block and back."""


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
        transfer_interval=None if strides else 0.0, dt=courant * cell / np.sqrt((law.lam + 2 * law.mu) / DENSITY))
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
    choices = {"model": model, "cells": cells, "courant": courant, "precision": precision, "strides": strides}
    return timed.record(NAME, choices, {"growth": share.max() - 1, "slope": trend, "rise": rise,
                                        "lost per period": 1 - share[-1] ** (1 / periods)}, energy_left=share[-1])

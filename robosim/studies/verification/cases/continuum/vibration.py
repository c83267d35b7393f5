"""Free vibration of elastic bodies."""

import numpy as np
from scipy.optimize import curve_fit

import mpm
from robosim.studies.verification.cases.beds import courant_step, set_up
from robosim.studies.verification.cases.case import Record, case, grid
from robosim.studies.verification.cases.expectations import Order, each_within

LENGTH, E, DENSITY, SPEED = 25.0, 100.0, 1.0, 0.1
"""Of the bar."""
BETA = np.pi / (2 * LENGTH)
OMEGA = BETA * np.sqrt(E / DENSITY)
FINE = {"courant": 0.2, "precision": "f64"}
LAWS = ("hencky", "neo_hookean", "fixed_corotated")
SIDE, BLOCK_E, NU, BLOCK_DENSITY, RATE = 0.1, 1e5, 0.3, 1000.0, 20.0
"""RATE [1/s]: the block begins to stretch along x and to shrink across, by some 15 % at the most."""
PERIOD = 2.0 * SIDE / np.sqrt(BLOCK_E / BLOCK_DENSITY)
"""[s] of a wave along the block and back."""


@case(
    source="first mode of a fixed-free bar, omega = pi/(2 L) sqrt(E/rho): Bardenhagen 2002; Steffen et al. 2008",
    sweep=grid(precision=("f64", "f32"), courant=(0.2, 0.5), cells=(13, 25, 50)),
    quick=grid(courant=(0.2,), precision=("f64",), cells=(13, 25, 50)),
    # order with zeroed walls: 1
    expectations=(*each_within({"frequency": 5e-4, "decay": 1e-3}, {"cells": 50, **FINE}),
                  Order("frequency", "cells", (13, 25), 1.8, FINE)),
    main_error="frequency", resolution="cells")
def bar(*, cells: int = 50, courant: float = 0.2, precision: str = "f64", periods: float = 4) -> Record:
    """Axial vibration of a bar between a wall and a free end.

    Measured: relative error of the frequency, its order, and the decay of the amplitude per period; the order is that
    of the walls. cells: along the bar."""
    cell = LENGTH / cells
    positions = mpm.sample_box((0, 0, 0), (LENGTH, 4 * cell, 4 * cell), cell / 2)
    velocity = np.zeros_like(positions)
    velocity[:, 0] = SPEED * np.sin(BETA * positions[:, 0])
    body = mpm.Body(mpm.Elastic(E=E, nu=0.0, density=DENSITY, model="neo_hookean"), positions,
                    volume=(cell / 2) ** 3, velocities=velocity)
    timed, solver = set_up(body, (LENGTH + 3 * cell, 4 * cell, 4 * cell), cell, gravity=(0, 0, 0),
                           walls=mpm.Walls.all("roller"), precision=precision, dt=courant * cell / np.sqrt(E / DENSITY))
    times, centre = [], []
    while solver.time < periods * 2 * np.pi / OMEGA:
        timed.advance(0.2)
        times.append(solver.time)
        centre.append(solver.positions()[:, 0].mean() - LENGTH / 2)

    def swing(t: np.ndarray, amplitude: float, omega: float, decay: float, shift: float, offset: float) -> np.ndarray:
        return offset + amplitude * np.exp(-decay * t) * np.sin(omega * t + shift)

    start = (SPEED / (BETA * LENGTH * OMEGA), OMEGA, 1e-5, 0.0, 0.0)
    fit, _ = curve_fit(swing, np.array(times), np.array(centre), p0=start)
    return timed.record({"frequency": abs(fit[1] / OMEGA - 1), "decay": fit[2] * 2 * np.pi / OMEGA})


@case(
    source="first law of thermodynamics for a hyperelastic body; energies of the three laws in closed form",
    sweep=grid(model=LAWS, courant=(0.1, 0.2, 0.3), strides=(True, False)), quick=grid(model=LAWS, courant=(0.3,)),
    # most that the energy rises above its start, and from any moment to a later one, as shares of the first (a stored
    # energy that is a tenth wrong swings by a tenth); that its trend over all periods gains, and that a period takes
    expectations=each_within({"growth": 0.02, "slope": 0.0, "rise": 0.05, "lost per period": 0.2}, low=-np.inf),
    main_error="lost per period", resolution="courant")
def elastic_energy(*, model: str = "hencky", cells: int = 12, courant: float = 0.3, precision: str = "f32",
                   strides: bool = True, periods: int = 10) -> Record:
    """Free vibration of an elastic block, for each elastic law.

    Measured: rise of the total energy, kinetic and elastic, above its start and after any moment, its trend, and the
    loss per period. cells: along a side."""
    cell = SIDE / cells
    law = mpm.Elastic(E=BLOCK_E, nu=NU, density=BLOCK_DENSITY, model=model)
    room, centre = 2.0 * SIDE, np.full(3, SIDE)
    positions = mpm.sample_box(centre - SIDE / 2, centre + SIDE / 2, cell / 2)
    velocities = RATE * (positions - centre) * (1.0, -NU, -NU)
    timed, solver = set_up(mpm.Body(law, positions, volume=SIDE**3 / len(positions), velocities=velocities),
                           (room, room, room), cell, gravity=(0, 0, 0), precision=precision,
                           transfer_interval=None if strides else 0.0, dt=courant_step(courant, cell, law))
    timed.advance(solver.dt)  # the affine part is there from the first gather on
    times, energies = [0.0], [sum(solver.energy())]
    for _ in range(40 * periods):
        timed.advance(PERIOD / 40)
        times.append(solver.time / PERIOD)
        energies.append(sum(solver.energy()))
    share = np.array(energies) / energies[0]
    return timed.record({"growth": share.max() - 1, "slope": np.polyfit(times, share, 1)[0],
                         "rise": (share - np.minimum.accumulate(share)).max(),
                         "lost per period": 1 - share[-1] ** (1 / periods)}, energy_left=share[-1])

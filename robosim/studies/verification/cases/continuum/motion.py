"""Blocks that fall, drift, spin and vibrate freely."""

import numpy as np
from scipy.optimize import curve_fit

import mpm
from robosim.studies.verification.cases.beds import courant_step, set_up
from robosim.studies.verification.cases.case import Record, case, grid
from robosim.studies.verification.cases.expectations import Order, Within, each_within

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
G = 9.81
BOTH = grid(precision=("f32", "f64"), strides=(True, False))


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


@case(
    source="x = x0 + v t + g t^2 / 2, exact in strides; t (t + dt) for t^2 in single substeps, symplectic Euler; for "
           "any partition of unity",
    sweep=BOTH, quick=BOTH,
    expectations=[Within("max", high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 1e-6))],
    main_error="max", units={"max": "m"})
def free_fall(*, precision: str = "f64", speed: float = 0.0, steps: int = 150, dt: float = 1e-3,
              strides: bool = True) -> Record:
    """Free fall of an elastic block.

    Measured: largest and rms error [m] of a particle's position. Reference: the trajectory of the integrator, whatever
    the grid's place and the block's speed [m/s] along x."""
    cell, low, velocity = 0.05, np.array([0.301, 0.301, 0.601]), np.array([speed, 0.0, 0.0])
    start = mpm.sample_box(low, low + 4 * cell, cell / 2)
    body = mpm.Body(mpm.Elastic(E=1e5, nu=0.3, density=1000.0), start, volume=(cell / 2) ** 3,
                    velocities=np.tile(velocity, (len(start), 1)))
    timed, solver = set_up(body, (1.6, 1, 1), cell, dt=dt, precision=precision,
                           transfer_interval=None if strides else 0.0)
    timed.advance(steps * dt)
    expected = start + velocity * steps * dt + np.array([0, 0, -G]) * dt**2 * steps * (steps + 1 - strides) / 2
    error = np.abs(solver.positions() - expected)
    return timed.record({"rms": np.sqrt((error**2).mean()), "max": error.max()})


@case(
    source="x = x0 + v t, as without forces", sweep=BOTH, quick=BOTH,
    # 0.03 is half of what is resolved at 1 m, over 4 micrometres and more
    expectations=[Within("displacement", high, {"precision": p}) for p, high in (("f64", 1e-5), ("f32", 0.03))],
    main_error="displacement")
def slow_translation(*, precision: str = "f32", speed: float = 1e-5, steps: int = 4000, dt: float = 2e-4,
                     strides: bool = True) -> Record:
    """Slow translation of a block of grains, a metre from the origin.

    Measured: relative errors of the mean displacement along each axis; the largest counts. Reference: v t; speed [m/s]
    along each axis. A substep's displacement, 2e-9 m, is far below what single precision resolves there, 1.2e-7 m: a
    position to which it is added as it is stays where it is."""
    cell = 0.02
    start = mpm.sample_box((0.9,) * 3, (0.9 + 3 * cell,) * 3, cell / 2, np.random.default_rng(0))
    sand = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
    body = mpm.Body(sand, start, np.full(start.shape, speed), volume=(cell / 2) ** 3)
    timed, solver = set_up(body, (1.2, 1.2, 1.2), cell, gravity=(0, 0, 0), dt=dt, precision=precision,
                           transfer_interval=None if strides else 0.0)
    timed.advance(steps * dt)
    moved = (solver.positions() - start).mean(0)
    return timed.record({"displacement": np.abs(moved / (speed * steps * dt) - 1.0).max()})


@case(
    source="conservation; Jiang et al. 2017, J. Comput. Phys. 338:137 for the affine part of the angular momentum",
    sweep=grid(precision=("f32", "f64"), courant=(0.2, 0.5)), quick=grid(precision=("f64", "f32"), courant=(0.2,)),
    expectations=[Within(name, high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 1e-5))
                  for name in ("linear", "angular")],
    main_error="angular")
def spin(*, precision: str = "f64", courant: float = 0.3, steps: int = 1000) -> Record:
    """Spin of a free elastic block about a slanted axis.

    Measured: change of linear [1/m] and angular momentum over the run, relative to the angular momentum; the affine
    part of the particles' velocities counts. Reference: conservation."""
    cell, rate, centre = 1 / 24, np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.5, 0.5])
    positions = mpm.sample_box(centre - 0.2, centre + 0.2, cell / 2)
    material = mpm.Elastic(E=1e4, nu=0.3, density=1000.0)
    body = mpm.Body(material, positions, volume=(cell / 2) ** 3, velocities=np.cross(rate, positions - centre))
    dt = courant_step(courant, cell, material)
    timed, solver = set_up(body, (1, 1, 1), cell, gravity=(0, 0, 0), dt=dt, precision=precision)
    timed.advance(dt)  # the affine part is there from the first gather on
    before, energy = solver.momentum(), solver.energy()
    timed.advance(steps * dt)
    after = solver.momentum()
    scale = np.abs(before.angular).max()
    errors = {"linear": np.abs(after.linear - before.linear).max() / scale,
              "angular": np.abs(after.angular - before.angular).max() / scale}
    return timed.record(errors, energy_ratio=sum(solver.energy()) / sum(energy))

"""Manufactured solutions: motions that a prescribed body acceleration makes exact."""

from collections.abc import Callable

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Order, Within

NU = 0.3
CUBE_E, CUBE_DENSITY, AMPLITUDE = 1e4, 1.0, 0.05
PHASE = np.array([0.0, 2.0 / 3.0, 4.0 / 3.0])
SPEED = np.sqrt(CUBE_E / CUBE_DENSITY)
CUBE_MU, CUBE_LAM = CUBE_E / (2 * (1 + NU)), CUBE_E * NU / ((1 + NU) * (1 - 2 * NU))
PERIOD = 2.0 / SPEED
E, DENSITY = 1000.0, 1000.0
"""Of the ring."""
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
FINE = {"courant": 0.2, "precision": "f64"}


def run(timed: TimedSolver, steps: int, dt: float, acceleration: Callable[[float], np.ndarray],
        error: Callable[[float], np.ndarray]) -> Record:
    """Advance in steps [s] under an acceleration [m/s^2] (n, 3); record the largest rms and single error (n, d).
    Each step has the acceleration of its middle, so that its own error is of second order."""
    rms = worst = 0.0
    for step in range(1, steps + 1):
        timed.solver.set_body_acceleration(acceleration(timed.solver.time + 0.5 * dt))
        timed.advance(dt)
        if step % max(1, steps // 20) == 0:
            lengths = error(timed.solver.time)
            rms, worst = max(rms, float(np.sqrt((lengths**2).mean()))), max(worst, float(lengths.max()))
    return timed.record({"rms": rms, "max": worst})


def displacement(X: np.ndarray, t: float) -> np.ndarray:
    """Return u [m] (n, 3) of the cube's material points X [m] (n, 3) at time t [s]."""
    return AMPLITUDE * np.sin(np.pi * X) * np.sin(np.pi * (PHASE + SPEED * t))


def stretch(X: np.ndarray, t: float) -> np.ndarray:
    """Return the diagonal (n, 3) of F at the cube's material points X [m] (n, 3) and time t [s]."""
    return 1 + np.pi * AMPLITUDE * np.cos(np.pi * X) * np.sin(np.pi * (PHASE + SPEED * t))


def cube_acceleration(X: np.ndarray, t: float, model: str) -> np.ndarray:
    """Return the body acceleration [m/s^2] (n, 3), from rho0 u_tt = Div P + rho0 b."""
    F = stretch(X, t)
    J = F.prod(1, keepdims=True)
    stiffness = {
        "neo_hookean": CUBE_MU + (CUBE_MU + CUBE_LAM * (1 - np.log(J))) / F**2,
        "fixed_corotated": 2 * CUBE_MU + CUBE_LAM * (J / F) ** 2,
        "hencky": (CUBE_LAM + 2 * CUBE_MU - 2 * CUBE_MU * np.log(F) - CUBE_LAM * np.log(J)) / F**2,
    }[model]
    return np.pi**2 * displacement(X, t) * (stiffness / CUBE_DENSITY - SPEED**2)


@case(
    source="Wallstedt & Guilkey 2008, J. Comput. Phys. 227:9628; in 3-D Kamojjala et al. 2015, Eng. w. Computers "
           "31:193, with the parameters of Uintah's MMS.cc",
    sweep=grid(precision=("f64", "f32"), courant=(0.2, 0.5), cells=(8, 16, 32)),
    quick=grid(courant=(0.2,), precision=("f64", "f32"), cells=(8, 16)),
    expectations=(*(Within("rms", high, {"cells": n}) for n, high in ((16, 0.02), (32, 0.008))),
                  *(Order("rms", "cells", ends, least, FINE) for ends, least in (((8, 16), 1.7), ((16, 32), 1.4)))),
    main_error="rms", resolution="cells")
def axis_aligned(*, cells: int = 16, courant: float = 0.2, precision: str = "f64", model: str = "neo_hookean",
                 periods: float = 1.0) -> Record:
    """Manufactured vibration of a unit cube along its axes.

    Measured: rms error of the positions over a period, in amplitudes, and its order. Reference: u_i = A sin(pi X_i)
    sin(pi (phi_i + c t)) between rollers. Walls that act out of place show at once: zeroed nodes give eight times the
    error, and order one."""
    cell = 1.0 / cells
    X = mpm.sample_box((0, 0, 0), (1, 1, 1), cell / 2)
    dt = courant * cell / np.sqrt((CUBE_LAM + 2 * CUBE_MU) / CUBE_DENSITY)
    steps = int(np.ceil(periods * PERIOD / dt))
    dt = periods * PERIOD / steps
    cosine = AMPLITUDE * np.pi * SPEED * np.cos(np.pi * PHASE)
    body = mpm.Body(mpm.Elastic(E=CUBE_E, nu=NU, density=CUBE_DENSITY, model=model), X + displacement(X, 0),
                    velocities=cosine * np.sin(np.pi * X), volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), cell), bodies=[body], walls=mpm.Walls.all("roller"),
                        gravity=(0, 0, 0), dt=dt * (1 + 1e-9), precision=precision, body_acceleration=np.zeros_like(X))
    state = solver.state()
    F = stretch(X, 0)
    state["C"][:, [0, 4, 8]] = np.pi * cosine * np.cos(np.pi * X) / F
    state["e"][:, :3] = F**2 - 1
    solver.load(state)
    return run(TimedSolver(solver), steps, dt, lambda t: cube_acceleration(X, t, model),
               lambda t: np.linalg.norm(solver.positions() - X - displacement(X, t), axis=1) / AMPLITUDE)


def shape(R: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return h(R) and its first and second derivative."""
    s = R - 1
    return 1 - 32 * s**2 + 256 * s**4, -64 * s + 1024 * s**3, -64 + 3072 * s**2


def twist(t: float, amplitude: float) -> tuple[float, float, float]:
    """Return g(t) and its first and second derivative."""
    w = 2 * np.pi
    return (amplitude / 2 * (1 - np.cos(w * t)), amplitude / 2 * w * np.sin(w * t),
            amplitude / 2 * w**2 * np.cos(w * t))


def ring_position(X: np.ndarray, t: float, amplitude: float) -> np.ndarray:
    """Return positions [m] (n, 2) at time t [s] of material points X [m] (n, 2) about the ring's centre."""
    angle = twist(t, amplitude)[0] * shape(np.hypot(*X.T))[0]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * X[:, 0] - sine * X[:, 1], sine * X[:, 0] + cosine * X[:, 1]], 1)


def ring_acceleration(X: np.ndarray, t: float, amplitude: float) -> np.ndarray:
    """Return the body acceleration [m/s^2] (n, 2) for neo-Hookean elasticity."""
    R = np.hypot(*X.T)
    (h, h1, h2), (g, g1, g2) = shape(R), twist(t, amplitude)
    radial = -R * (g1 * h) ** 2 + MU / DENSITY * R * (g * h1) ** 2
    around = R * g2 * h - MU / DENSITY * (3 * g * h1 + R * g * h2)
    angle = np.arctan2(X[:, 1], X[:, 0]) + g * h
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([radial * cosine - around * sine, radial * sine + around * cosine], 1)


@case(
    source="Kamojjala et al. 2015, Eng. w. Computers 31:193 (generalized vortex); parameters of Uintah's MMS.cc",
    sweep=grid(precision=("f64", "f32"), courant=(0.2, 0.5), cells=(10, 20, 40)),
    quick=grid(courant=(0.2,), precision=("f64",), cells=(10, 20, 40)),
    expectations=(Within("rms", 0.02, {"cells": 40, "courant": 0.2}), Order("rms", "cells", (20, 40), 1.5, FINE)),
    main_error="rms", resolution="cells")
def vortex(*, cells: int = 40, courant: float = 0.2, precision: str = "f64", amplitude: float = 0.1) -> Record:
    """Manufactured twist of a ring in plane strain, by up to 70 % shear.

    Measured: rms error of the positions over a period of 1 s [m per radian of twist], and its order. Reference: the
    angle alpha(R, t) = (A / 2) (1 - cos 2 pi t) (1 - 32 (R - 1)^2 + 256 (R - 1)^4). Both rims stay free of stress and
    displacement, so that no boundary condition takes part. cells: per metre."""
    cell = 1.0 / cells
    lattice = mpm.sample_box((-1.25, -1.25, 0), (1.25, 1.25, cell), cell / 2)
    R = np.hypot(*lattice[:, :2].T)
    lattice = lattice[(R >= 0.75) & (R <= 1.25)]
    X = lattice[:, :2]
    dt = courant * cell / np.sqrt((LAM + 2 * MU) / DENSITY)
    steps = int(np.ceil(1.0 / dt))
    dt = 1.0 / steps
    room, sides = 1.25 + 3 * cell, ("slip", "slip", "periodic")
    body = mpm.Body(mpm.Elastic(E=E, nu=NU, density=DENSITY, model="neo_hookean"), lattice, volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((-room, -room, 0), (room, room, cell), cell), bodies=[body],
                        walls=mpm.Walls(lower=sides, upper=sides), gravity=(0, 0, 0), dt=dt * (1 + 1e-9),
                        precision=precision, body_acceleration=np.zeros_like(lattice))
    return run(TimedSolver(solver), steps, dt, lambda t: np.pad(ring_acceleration(X, t, amplitude), ((0, 0), (0, 1))),
               lambda t: np.linalg.norm(solver.positions()[:, :2] - ring_position(X, t, amplitude), axis=1) / amplitude)

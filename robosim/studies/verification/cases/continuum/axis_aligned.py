"""Manufactured vibration of a unit cube along its axes.

Measured: rms error of the positions over a period, in amplitudes, and its order. Reference: u_i = A sin(pi X_i)
sin(pi (phi_i + c t)) between rollers, which a prescribed body acceleration makes an exact solution. Walls that act out
of place show at once: zeroed nodes give eight times the error, and order one.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Order, Within

E, NU, DENSITY, AMPLITUDE = 1e4, 0.3, 1.0, 0.05
PHASE = np.array([0.0, 2.0 / 3.0, 4.0 / 3.0])
SPEED = np.sqrt(E / DENSITY)
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
PERIOD = 2.0 / SPEED


def displacement(X: np.ndarray, t: float) -> np.ndarray:
    """Return u [m] (n, 3) of material points X [m] (n, 3) at time t [s]."""
    return AMPLITUDE * np.sin(np.pi * X) * np.sin(np.pi * (PHASE + SPEED * t))


def stretch(X: np.ndarray, t: float) -> np.ndarray:
    """Return the diagonal (n, 3) of F at material points X [m] (n, 3) and time t [s]."""
    return 1 + np.pi * AMPLITUDE * np.cos(np.pi * X) * np.sin(np.pi * (PHASE + SPEED * t))


def acceleration(X: np.ndarray, t: float, model: str) -> np.ndarray:
    """Return the body acceleration [m/s^2] (n, 3), from rho0 u_tt = Div P + rho0 b."""
    F = stretch(X, t)
    J = F.prod(1, keepdims=True)
    stiffness = {
        "neo_hookean": MU + (MU + LAM * (1 - np.log(J))) / F**2,
        "fixed_corotated": 2 * MU + LAM * (J / F) ** 2,
        "hencky": (LAM + 2 * MU - 2 * MU * np.log(F) - LAM * np.log(J)) / F**2,
    }[model]
    return np.pi**2 * displacement(X, t) * (stiffness / DENSITY - SPEED**2)


@case(
    source="Wallstedt & Guilkey 2008, J. Comput. Phys. 227:9628; in 3-D Kamojjala et al. 2015, Eng. w. Computers "
           "31:193, with the parameters of Uintah's MMS.cc",
    sweep=grid(precision=("f64", "f32"), courant=(0.2, 0.5), cells=(8, 16, 32)),
    quick=grid(courant=(0.2,), precision=("f64", "f32"), cells=(8, 16)),
    # at Courant number 0.5 the step's own error, of first order, outweighs the cells': the force changes with every
    # substep, so that no stride is longer
    expectations=(*(Within("rms", high, {"cells": n, "courant": 0.2}) for n, high in ((16, 0.02), (32, 0.008))),
                  *(Order("rms", "cells", ends, least, {"courant": 0.2, "precision": "f64"})
                    for ends, least in (((8, 16), 1.7), ((16, 32), 1.4)))),
    main_error="rms", resolution="cells")
def measure(*, cells: int = 16, courant: float = 0.2, precision: str = "f64", model: str = "neo_hookean",
            periods: float = 1.0) -> Record:
    """Run the case; return the largest rms error and the largest single error, in amplitudes."""
    cell = 1.0 / cells
    X = mpm.sample_box((0, 0, 0), (1, 1, 1), cell / 2)
    dt = courant * cell / np.sqrt((LAM + 2 * MU) / DENSITY)
    steps = int(np.ceil(periods * PERIOD / dt))
    dt = periods * PERIOD / steps
    cosine = AMPLITUDE * np.pi * SPEED * np.cos(np.pi * PHASE)
    body = mpm.Body(mpm.Elastic(E=E, nu=NU, density=DENSITY, model=model), X + displacement(X, 0),
                    velocities=cosine * np.sin(np.pi * X), volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), cell), bodies=[body], walls=mpm.Walls.all("roller"),
                        gravity=(0, 0, 0), dt=dt * (1 + 1e-9), precision=precision, body_acceleration=np.zeros_like(X))
    state = solver.state()
    F = stretch(X, 0)
    state["C"][:, [0, 4, 8]] = rate = np.pi * cosine * np.cos(np.pi * X) / F
    # a substep begins with the strain that C brings: what is stored is the strain before it
    state["e"][:, :3] = (F / (1 + dt * rate)) ** 2 - 1
    solver.load(state)
    timed = TimedSolver(solver)
    rms = worst = 0.0
    for step in range(1, steps + 1):
        solver.set_body_acceleration(acceleration(X, solver.time, model))
        timed.advance(dt)
        if step % max(1, steps // 20) == 0:
            error = np.linalg.norm(solver.positions() - X - displacement(X, solver.time), axis=1) / AMPLITUDE
            rms, worst = max(rms, float(np.sqrt((error**2).mean()))), max(worst, float(error.max()))
    return timed.record({"rms": rms, "max": worst})

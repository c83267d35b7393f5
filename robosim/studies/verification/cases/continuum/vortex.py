"""Manufactured twist of a ring in plane strain, by up to 70 % shear.

Measured: rms error of the positions over a period, and its order. Reference: the angle alpha(R, t) = (A / 2)
(1 - cos 2 pi t) (1 - 32 (R - 1)^2 + 256 (R - 1)^4), which a prescribed body acceleration makes an exact solution. Both
rims stay free of stress and displacement, so that no boundary condition takes part.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Order, Within

E, NU, DENSITY = 1000.0, 0.3, 1000.0
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))


def shape(R: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return h(R) and its first and second derivative."""
    s = R - 1
    return 1 - 32 * s**2 + 256 * s**4, -64 * s + 1024 * s**3, -64 + 3072 * s**2


def twist(t: float, amplitude: float) -> tuple[float, float, float]:
    """Return g(t) and its first and second derivative."""
    w = 2 * np.pi
    return (amplitude / 2 * (1 - np.cos(w * t)), amplitude / 2 * w * np.sin(w * t),
            amplitude / 2 * w**2 * np.cos(w * t))


def position(X: np.ndarray, t: float, amplitude: float) -> np.ndarray:
    """Return positions [m] (n, 2) at time t [s] of material points X [m] (n, 2) about the ring's centre."""
    angle = twist(t, amplitude)[0] * shape(np.hypot(*X.T))[0]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * X[:, 0] - sine * X[:, 1], sine * X[:, 0] + cosine * X[:, 1]], 1)


def acceleration(X: np.ndarray, t: float, amplitude: float) -> np.ndarray:
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
    # [amplitudes in m]; at Courant number 0.2, as in `axis_aligned`
    expectations=(Within("rms", 0.02, {"cells": 40, "courant": 0.2}),
                  Order("rms", "cells", (20, 40), 1.5, {"courant": 0.2, "precision": "f64"})),
    main_error="rms", resolution="cells")
def measure(*, cells: int = 40, courant: float = 0.2, precision: str = "f64", amplitude: float = 0.1) -> Record:
    """Run the case over a period of 1 s; return rms errors [m per radian of twist]. cells: per metre."""
    cell = 1.0 / cells
    lattice = mpm.sample_box((-1.25, -1.25, 0), (1.25, 1.25, cell), cell / 2)
    R = np.hypot(*lattice[:, :2].T)
    lattice = lattice[(R >= 0.75) & (R <= 1.25)]
    X = lattice[:, :2]
    dt = courant * cell / np.sqrt((LAM + 2 * MU) / DENSITY)
    steps = int(np.ceil(1.0 / dt))
    dt = 1.0 / steps
    room = 1.25 + 3 * cell
    slab = mpm.Walls(lower=("slip", "slip", "periodic"), upper=("slip", "slip", "periodic"))
    body = mpm.Body(mpm.Elastic(E=E, nu=NU, density=DENSITY, model="neo_hookean"), lattice, volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((-room, -room, 0), (room, room, cell), cell), bodies=[body], walls=slab,
                        gravity=(0, 0, 0), dt=dt * (1 + 1e-9), precision=precision,
                        body_acceleration=np.zeros_like(lattice))
    timed = TimedSolver(solver)
    force = np.zeros_like(lattice)
    rms = worst = 0.0
    for step in range(1, steps + 1):
        force[:, :2] = acceleration(X, solver.time, amplitude)
        solver.set_body_acceleration(force)
        timed.advance(dt)
        if step % max(1, steps // 20) == 0:
            error = np.linalg.norm(solver.positions()[:, :2] - position(X, solver.time, amplitude), axis=1) / amplitude
            rms, worst = max(rms, float(np.sqrt((error**2).mean()))), max(worst, float(error.max()))
    return timed.record({"rms": rms, "max": worst})

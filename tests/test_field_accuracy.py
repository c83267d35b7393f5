"""The field against exact solutions in motion: order of the walls, hydrostatics (validation sections A3, A8)."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

import mpm


def bar_frequency(cells: int, periods: int = 4) -> tuple[float, float]:
    """Relative error of the frequency and decay per period of a bar, fixed at one end and free at the other.

    L = 25, E = 100, rho = 1, nu = 0, v = 0.1 sin(pi x / 2 L): omega = 0.62832 (Bardenhagen 2002; Steffen et al. 2008).
    """
    length, cell = 25.0, 25.0 / cells
    positions = mpm.sample_box((0, 0, 0), (length, 4 * cell, 4 * cell), cell / 2)
    beta = np.pi / (2 * length)
    velocity = np.zeros_like(positions)
    velocity[:, 0] = 0.1 * np.sin(beta * positions[:, 0])
    body = mpm.Body(mpm.Elastic(E=100.0, nu=0.0, density=1.0, model="neo_hookean"), positions, volume=(cell / 2) ** 3,
                    velocities=velocity)
    roller = mpm.Walls(lower=("roller",) * 3, upper=("roller",) * 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (length + 3 * cell, 4 * cell, 4 * cell), cell), bodies=[body],
                        gravity=(0, 0, 0), walls=roller, dt=0.2 * cell / 10.0, precision="f64")
    omega, times, centre = beta * 10.0, [], []
    while solver.time < periods * 10.0:
        solver.advance(0.2)
        times.append(solver.time)
        centre.append(solver.positions()[:, 0].mean() - length / 2)

    def model(t: np.ndarray, amplitude: float, w: float, decay: float, shift: float, offset: float) -> np.ndarray:
        return offset + amplitude * np.exp(-decay * t) * np.sin(w * t + shift)

    start = (0.1 / (beta * length * omega), omega, 1e-5, 0.0, 0.0)
    fit, _ = curve_fit(model, np.array(times), np.array(centre), p0=start)
    return abs(fit[1] / omega - 1.0), fit[2] * 10.0


def test_walls_are_second_order() -> None:
    """A zeroed wall would give order 1 and 60 times the error."""
    coarse, fine, finest = bar_frequency(13), bar_frequency(25), bar_frequency(50)
    assert finest[0] <= 5e-4
    assert np.log2(coarse[0] / fine[0]) / np.log2(25 / 13) >= 1.8
    assert finest[1] <= 1e-3


def test_water_column_is_hydrostatic() -> None:
    """p = rho0 g Z in material depth; height 0.0995095 m for H0 = 0.1 m, K = 1e5 Pa; no shear at rest."""
    cell, height = 0.005, 0.1
    positions = mpm.sample_box((0, 0, 0), (4 * cell, 4 * cell, height), cell / 2)
    depth = height - positions[:, 2]
    water = mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=0.001)
    body = mpm.Body(water, positions, volume=(cell / 2) ** 3)
    roller = mpm.Walls(lower=("roller",) * 3, upper=("roller",) * 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (4 * cell, 4 * cell, 0.12), cell), bodies=[body], walls=roller)
    for _ in range(100):  # kinetic damping
        solver.advance(2e-3)
        state = solver.state()
        state["v"] *= 0.8
        solver.load(state)
    j = solver.state()["j"][:, 0].astype(float)
    pressure = -1e5 * j
    slope, base = np.polyfit(depth, pressure, 1)
    assert slope == pytest.approx(1000.0 * 9.81, rel=0.02)
    assert base + slope * height == pytest.approx(981.0, rel=0.02)
    top = depth < cell
    assert (solver.positions()[top, 2] + depth[top]).mean() == pytest.approx(0.0995095, abs=2e-5)

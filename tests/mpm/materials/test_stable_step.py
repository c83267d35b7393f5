"""Time steps of a lone particle: it is stable up to the accepted bound, and can resonate beyond it."""

import numpy as np
import pytest
from field_parts import block, sand
from scipy.optimize import brentq

import mpm
from mpm.materials.stable_step import (
    ACCEPTED_FRACTION,
    COURANT_FRACTION,
    accepted_bound,
    isolated_particle_bound,
    material_bound,
)
from mpm.stepping.stride import LONGEST

THIRD = np.sqrt(3) / 2
"""Share of the bound at which the volumetric mode turns its phase by a third of a circle in a step."""


def resonant_share(nu: float) -> float:
    """Share f of the bound at which one volumetric and two deviatoric phases add up to a circle."""
    ratio = 1 + 3 * nu / (1 - 2 * nu)
    return brentq(lambda f: 2 * f**2 / (1 + np.sqrt(1 - f**2)) - ratio, 0.5, 1.0)


def largest_strain(nu: float, shares: np.ndarray, steps: int, amplitude: float = 0.01) -> np.ndarray:
    """Largest |b - I| of lone neo-Hookean particles with steps of these shares of the bound; infinite if it diverges.
    The map of a substep without the grid: C <- C - 4 dt tau / (density cell^2), b <- (I + dt C) b (I + dt C)^T."""
    mu, lam, eye, n = 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu)), np.eye(3), len(shares)
    dt = shares * isolated_particle_bound(1.0, 1.0, mu, lam)
    stretch = np.random.default_rng(0).normal(size=(n, 3, 3)) * amplitude
    stretch = eye + (stretch + stretch.transpose(0, 2, 1)) / 2
    b, C, largest = stretch @ stretch, np.zeros((n, 3, 3)), np.zeros(n)
    with np.errstate(all="ignore"):
        for _ in range(steps):
            tau = mu * (b - eye) + 0.5 * lam * np.log(np.linalg.det(b))[:, None, None] * eye
            C = C - 4 * dt[:, None, None] * tau
            L = eye + dt[:, None, None] * C
            b = L @ b @ L.transpose(0, 2, 1)
            size = np.abs(b - eye).max((1, 2))
            largest = np.where(size < 1.0, np.maximum(largest, size), np.inf)
            b, C = np.where(size[:, None, None] < 1.0, b, eye), np.where(size[:, None, None] < 1.0, C, 0.0)
    return largest


def test_the_bound_is_that_of_an_isolated_particle() -> None:
    """In cells that a pressure wave of the bulk travels: sqrt((lam + 2 mu) / (3 lam + 2 mu)), for nu = 0.3."""
    law = mpm.Elastic(E=1e5, nu=0.3, density=1500.0)
    wave = np.sqrt((law.lam + 2 * law.mu) / law.density)
    assert material_bound(0.02, law) * wave / 0.02 == pytest.approx(0.734, abs=5e-4)


@pytest.mark.parametrize("nu", [0.0, 0.05, 0.1, 0.15, 0.3, 0.45])
def test_a_lone_particle_resonates_beyond_the_accepted_step(nu: float) -> None:
    """Its linear modes are stable up to 1. Two-to-one for nu < 0.2; three-to-one for every material."""
    shares = np.repeat([THIRD, resonant_share(nu) if nu < 0.2 else THIRD], 6)
    assert np.isinf(largest_strain(nu, shares, 600)).reshape(2, 6).any(1).all()
    accepted = np.repeat([COURANT_FRACTION, 0.8, ACCEPTED_FRACTION], 6)
    assert largest_strain(nu, accepted, 4000).max() < 0.3


@pytest.mark.long
def test_the_solver_resonates_as_the_map_does() -> None:
    """Its strain stays what it was with the largest accepted step; with 0.95 of the bound it is lost."""
    law = mpm.Elastic(E=1e5, nu=0.1, density=1500.0, model="neo_hookean")
    body = mpm.Body(law, np.array([[0.0512, 0.0487, 0.0533]]), volume=0.0025**3)
    grid = mpm.Grid((0, 0, 0), (0.1, 0.1, 0.1), 0.005)
    bound = material_bound(grid.cell, law)
    solver = mpm.Solver(grid=grid, bodies=[body], gravity=(0, 0, 0), precision="f64", dt=ACCEPTED_FRACTION * bound)
    start = solver.state()
    start["e"][0] = np.array([2.0, -1.0, -2.0, 1.0, -1.5, 0.5]) * 0.01
    solver.load(start)
    for _ in range(20):
        solver.advance(100 * solver.dt)
        assert np.abs(solver.state()["e"]).max() < 0.2
    solver.load(start)
    solver.core.dt = resonant_share(0.1) * bound  # which the constructor refuses
    with pytest.raises((mpm.SimulationDiverged, AssertionError), match="diverged|lost"):
        for _ in range(20):
            solver.advance(100 * solver.dt)
            assert np.abs(solver.state()["e"]).max() <= 0.5, "the strain is lost"


def test_steps_are_accepted_up_to_the_bound_of_every_material() -> None:
    """The default step does not depend on what is accepted."""
    soft, stiff = (mpm.Elastic(E=E, nu=0.3, density=1000.0) for E in (1e4, 1e5))
    grid = mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02)
    bodies = [block(law, (x, 0, 0), (x + 0.04, 0.04, 0.04), 0.01) for law, x in ((soft, 0.0), (stiff, 0.1))]
    bound = isolated_particle_bound(0.02, 1000.0, stiff.mu, stiff.lam)
    solver = mpm.Solver(grid=grid, bodies=bodies)
    assert (solver.dt, solver.bound, solver.transfer_interval) == (COURANT_FRACTION * bound, bound, LONGEST * bound)
    assert accepted_bound(0.02, stiff) == ACCEPTED_FRACTION * bound
    with pytest.raises(mpm.TimeStepTooLarge, match="isolated particle") as caught:
        mpm.Solver(grid=grid, bodies=bodies, dt=0.84 * bound)
    assert caught.value.bound == ACCEPTED_FRACTION * bound
    with pytest.raises(mpm.TimeStepTooLarge):
        solver.set_material(1, mpm.Elastic(E=1.3e5, nu=0.3, density=1000.0))
    solver.set_material(1, mpm.Elastic(E=1.2e5, nu=0.3, density=1000.0))

    sparse = mpm.Solver(grid=grid, bodies=[block(sand(), (0, 0, 0), (0.04, 0.04, 0.04), 0.01)])
    bound = sparse.bound
    with pytest.raises(mpm.TimeStepTooLarge, match="packing of grains"):
        sparse.settings.set_volume(0, 0.02**3)
    sparse.settings.set_volume(0, 0.55 * 0.02**3)
    assert 0.9 * bound < sparse.bound < bound


def test_viscosity_bounds_the_step_without_resonance() -> None:
    """It damps: nothing is taken off its bound."""
    syrup = mpm.NewtonianFluid(bulk_modulus=1e3, density=1000.0, viscosity=100.0)
    assert accepted_bound(0.01, syrup) == material_bound(0.01, syrup) == 1000.0 * 0.01**2 / 400.0

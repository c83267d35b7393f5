"""Laws of the field: exact free fall, conservation, hydrostatics."""

import numpy as np
import pytest

import mpm

G = 9.81


def cube(precision: str, velocity=(0.0, 0.0, 0.0), n: int = 8) -> mpm.Solver:
    cell = 0.05
    low = np.array([0.301, 0.301, 0.601])
    positions = mpm.sample_box(low, low + n * cell / 2, cell / 2)
    body = mpm.Body(mpm.Elastic(E=1e5, nu=0.3, density=1000.0), positions, volume=(cell / 2) ** 3,
                    velocities=np.tile(velocity, (len(positions), 1)))
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (1.6, 1, 1), cell), bodies=[body], dt=1e-3, precision=precision)


@pytest.mark.parametrize(("precision", "bound"), [("f64", 1e-12), ("f32", 2e-6)])
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (5.0, 0.0, 0.0)])
def test_free_fall_is_exact(precision: str, bound: float, velocity: tuple[float, ...]) -> None:
    """Symplectic Euler gives x0 + v n dt + g dt^2 n (n + 1) / 2 for every particle (validation A1)."""
    solver = cube(precision, velocity)
    start, n, dt = solver.positions(), 150, 1e-3
    solver.advance(n * dt)
    expected = start + np.array(velocity) * n * dt + np.array([0, 0, -G]) * dt**2 * n * (n + 1) / 2
    assert np.abs(solver.positions() - expected).max() <= bound


def test_spinning_block_keeps_its_momentum() -> None:
    """Angular momentum needs the affine part; in double precision it drifts by rounding only (validation A5)."""
    cell, omega = 1 / 24, np.array([1.0, 2.0, 3.0])
    centre = np.array([0.5, 0.5, 0.5])
    positions = mpm.sample_box(centre - 0.15, centre + 0.15, cell / 2)
    body = mpm.Body(mpm.Elastic(E=1e4, nu=0.3, density=1000.0), positions, volume=(cell / 2) ** 3,
                    velocities=np.cross(omega, positions - centre))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), cell), bodies=[body], gravity=(0, 0, 0), precision="f64")
    solver.advance(solver.dt)
    before = solver.momentum()
    solver.advance(200 * solver.dt)
    after = solver.momentum()
    scale = np.abs(before.angular).max()
    assert np.abs(after.angular - before.angular).max() <= 1e-12 * scale
    assert np.abs(after.linear - before.linear).max() <= 1e-12 * scale


def test_mass_is_exact() -> None:
    solver = cube("f64")
    assert solver.masses().sum() == pytest.approx(1000.0 * len(solver.positions()) * 0.025**3, rel=1e-15)
    solver.advance(0.02)
    # gravity's impulse is the mass on the grid nodes, summed over all substeps
    assert solver.ledger[0, 2] == pytest.approx(-G * 0.02 * solver.masses().sum(), rel=1e-13)


@pytest.mark.parametrize(("condition", "precision", "bound"),
                         [("friction", "f64", 1e-12), ("roller", "f64", 1e-12), ("stick", "f64", 1e-12),
                          ("friction", "f32", 1e-5)])
def test_ledger_closes_against_walls(condition: str, precision: str, bound: float) -> None:
    """What the grains gain is gravity and wall impulses and nothing else, linear and angular."""
    cell = 0.02
    positions = mpm.sample_box((0, 0, 0), (0.1, 0.14, 0.1), cell / 2, np.random.default_rng(1))
    material = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
    body = mpm.Body(material, positions, volume=(cell / 2) ** 3,
                    velocities=np.tile([-1.0, 0.5, -0.5], (len(positions), 1)))
    walls = mpm.Walls(lower=(condition,) * 3, upper=(condition,) * 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), cell), bodies=[body], walls=walls,
                        precision=precision)
    before, total, exchanged = solver.momentum(), np.zeros(6), np.zeros(2)
    for _ in range(40):
        solver.advance(10 * solver.dt)
        rows = solver.ledger[:2]
        total += rows.sum(0)
        exchanged += [np.abs(rows[:, :3]).sum(), np.abs(rows[:, 3:]).sum()]
    after = solver.momentum()
    assert np.abs(after.linear - before.linear - total[:3]).max() <= bound * exchanged[0]
    assert np.abs(after.angular - before.angular - total[3:]).max() <= bound * exchanged[1]


@pytest.mark.parametrize(("cells", "bound"), [(20, 0.03), (40, 0.015)])
def test_oedometer(cells: int, bound: float) -> None:
    """A laterally confined column under its weight: P_zz = -rho0 g (l0 - Z) for any law; settlement 2.139780 mm for
    Hencky elasticity at E = 1e5 Pa, nu = 0.3, rho = 1500, l0 = 0.2 m (validation A7)."""
    length, cell = 0.2, 0.2 / cells
    positions = mpm.sample_box((0, 0, 0), (4 * cell, 4 * cell, length), cell / 2)
    depth = length - positions[:, 2]
    body = mpm.Body(mpm.Elastic(E=1e5, nu=0.3, density=1500.0), positions, volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (4 * cell, 4 * cell, 0.25), cell), bodies=[body],
                        walls=mpm.Walls(lower=("roller",) * 3, upper=("roller",) * 3))
    for _ in range(150):  # kinetic damping: stop the column whenever it swings through
        solver.advance(2e-3)
        state = solver.state()
        state["v"] *= 0.8
        solver.load(state)
    e = solver.state()["e"].astype(float)
    h = 0.5 * np.log1p(e[:, :3])
    mu, lam = body.material.mu, body.material.lam
    tau = 2 * mu * h[:, 2] + lam * h.sum(1)
    first_piola = tau / np.exp(h[:, 2])
    reference = -1500.0 * G * depth
    assert np.abs(first_piola - reference).mean() / (1500.0 * G * length) <= bound
    top = depth < cell
    settlement = (length - depth - solver.positions()[:, 2])[top].mean()
    assert settlement == pytest.approx(2.139780e-3, rel=0.02)

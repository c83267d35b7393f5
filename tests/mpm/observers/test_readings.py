"""What a solver can be asked for: stresses and densities by each law's formula, impulses on each wall."""

import numpy as np
import pytest
from field_parts import block, sand

import mpm
from mpm.observers.diagnostics import eigenvalues

E, NU, RHO = 2e5, 0.3, 1300.0
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
SAND, STIFF = sand(E=E, nu=NU, density=RHO), sand(E=1.5e5, nu=0.3, friction_angle_deg=35.0)


def hencky(F: np.ndarray) -> np.ndarray:
    """Kirchhoff stress 2 mu h + lam tr(h) I with h = ln(F F^T) / 2."""
    values, axes = np.linalg.eigh(F @ F.T)
    h = (axes * (0.5 * np.log(values))) @ axes.T
    return 2 * MU * h + LAM * np.trace(h) * np.eye(3)


def neo_hookean(F: np.ndarray) -> np.ndarray:
    """Kirchhoff stress mu (b - I) + lam ln(J) I."""
    return MU * (F @ F.T - np.eye(3)) + LAM * np.log(np.linalg.det(F)) * np.eye(3)


def fixed_corotated(F: np.ndarray) -> np.ndarray:
    """Kirchhoff stress 2 mu (F - R) F^T + lam (J - 1) J I (Stomakhin et al. 2012)."""
    U, _, Vt = np.linalg.svd(F)
    J = np.linalg.det(F)
    return 2 * MU * (F - U @ Vt) @ F.T + LAM * (J - 1) * J * np.eye(3)


@pytest.mark.parametrize("stress", [hencky, neo_hookean, fixed_corotated])
def test_stresses_are_those_of_the_law(stress):
    rng = np.random.default_rng(3)
    positions = rng.uniform(0.04, 0.16, (7, 3))
    body = mpm.Body(mpm.Elastic(E=E, nu=NU, density=RHO, model=stress.__name__), positions, volume=1e-6)
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[body], precision="f64") as solver:
        F = np.eye(3) + 0.1 * rng.uniform(-1, 1, (7, 3, 3))
        b = F @ F.transpose(0, 2, 1) - np.eye(3)
        state = solver.state()
        state["e"] = b.reshape(-1, 9)[:, [0, 4, 8, 1, 2, 5]]
        solver.load(state)
        J = np.linalg.det(F)
        expected = np.array([stress(one) for one in F]) / J[:, None, None]
        assert solver.stresses() == pytest.approx(expected, rel=1e-9, abs=1e-6)
        assert np.abs(expected).max() > 1e3 and solver.densities() == pytest.approx(RHO / J, rel=1e-12)
        assert np.array_equal(solver.state()["e"], state["e"])


def test_two_laws_in_a_scene_each_give_their_own():
    """A fluid under pressure and sand at its yield surface: stress of the sand has the ratio of the cone."""
    water = mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=0.0)
    places = np.array([[0.05, 0.05, 0.05], [0.06, 0.05, 0.05]])
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), precision="f64", bodies=[
            mpm.Body(water, places, volume=1e-6), mpm.Body(SAND, places + 0.08, volume=1e-6)]) as solver:
        state = solver.state()
        state["j"][:2] = -0.01
        h = np.array([-0.01, -0.01, -0.02])
        state["e"][2:, :3] = np.exp(2 * h) - 1
        state["around"][2:] = RHO * 0.02**3  # as stiff as inside a bed
        solver.load(state)
        stresses = solver.stresses()
        assert stresses[:2] == pytest.approx(np.tile(-1e5 * 0.01 * np.eye(3), (2, 1, 1)), rel=1e-9, abs=1e-9)
        expected = np.diag(2 * MU * h + LAM * h.sum()) / np.exp(h.sum())
        assert stresses[2:] == pytest.approx(np.tile(expected, (2, 1, 1)), rel=1e-9, abs=1e-6)
        assert solver.densities() == pytest.approx([1000 / 0.99] * 2 + [RHO / np.exp(h.sum())] * 2)


def test_the_impulses_of_the_walls_are_those_that_the_particles_lack():
    """A block is thrown into a corner: six walls add up to the ledger's row, and momentum closes wall by wall."""
    body = block(SAND, (0.0, 0.06, 0.0), (0.06, 0.14, 0.06), 0.01, (-0.5, 0.0, -0.5))
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[body], walls=mpm.Walls.all("slip"),
                    precision="f64") as solver:
        before, duration = solver.momentum(), 0.02
        solver.advance(duration)
        received = {side: solver.wall_impulse(side) for side in ("x-", "x+", "y-", "y+", "z-", "z+")}
        weight = duration * solver.masses().sum() * solver.gravity
        lost = before.linear + weight - solver.momentum().linear
        tolerance = 1e-12 * np.abs(lost).max()
        assert received["x-"].force[0] == pytest.approx(lost[0], abs=tolerance) and lost[0] < -1e-3
        assert received["z-"].force[2] == pytest.approx(lost[2], abs=tolerance) and lost[2] < -1e-3
        for side in ("x+", "y-", "y+", "z+"):
            assert not received[side].force.any() and not received[side].torque.any()
        total = sum(np.concatenate(wrench) for wrench in received.values())
        assert -total == pytest.approx(solver.ledger[1], abs=1e-15)
        point = np.array([0.1, 0.2, 0.3])
        about = solver.wall_impulse("z-", point)
        assert about.torque == pytest.approx(received["z-"].torque - np.cross(point, received["z-"].force), abs=1e-15)
        with pytest.raises(mpm.UnknownName, match="side 'floor'"):
            solver.wall_impulse("floor")


def thrown(velocity: tuple[float, float, float], walls: str = "roller") -> mpm.Solver:
    """A block in the middle of a box, with a velocity [m/s] of all its particles."""
    body = block(STIFF, (0.05,) * 3, (0.08,) * 3, 0.005, velocity)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.01), bodies=[body], walls=mpm.Walls.all(walls),
                      dt=4.6e-4)


@pytest.mark.long
def test_particles_that_would_leave_the_grid_are_reported_once() -> None:
    """At 15 m/s, 0.7 cells a substep, some pass a wall that cannot be left. The floor is left out: what lies there has
    left nothing. A wall that can be left stops them before its plane."""
    solver = thrown((15.0, 0.0, 0.0), "friction")
    solver.advance(0.15)
    assert np.abs(solver.positions()[:, 0] - 0.1).max() > 0.099 and solver.diagnostics().escaped == 0
    solver = thrown((15.0, 0.0, 0.0))
    with pytest.warns(mpm.GrainsLeaveGrid, match=r"would have left the grid by t = .* walls \([xy][-+]|z\+") as caught:
        for _ in range(40):
            if not caught:
                solver.advance(5e-3)
    assert caught[0].filename == __file__
    x = solver.positions()
    held = (x[:, :2] <= 1e-6).any(1) | (x >= 0.2 - 1e-6).any(1)
    assert str(caught[0].message).startswith(f"{held.sum()} of 216 particles")
    solver.advance(5e-3)  # a second warning would be an error here


@pytest.mark.slow
def test_a_batch_reports_them_too() -> None:
    batch = mpm.Batch(thrown((20.0, 0.0, 0.0)), 2)
    with pytest.warns(mpm.GrainsLeaveGrid) as caught:
        for _ in range(40):
            if not caught:
                batch.advance(np.full(2, 5e-3), np.ones(2, int))


@pytest.mark.long
def test_particles_that_lie_on_a_floor_are_no_such() -> None:
    """A heap, and a single particle that nothing but the floor's pressure holds; warnings are errors here."""
    solver = thrown((0.0, 0.0, 0.0), "friction")
    for _ in range(10):
        solver.advance(0.05)
    assert solver.diagnostics().escaped == 0
    alone = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.01),
                       bodies=[mpm.Body(STIFF, np.array([[0.1, 0.1, 0.02]]), volume=1e-7)])
    for _ in range(10):
        alone.advance(0.1)
    assert alone.positions()[0, 2] < 1e-3 and alone.diagnostics().escaped == 0


@pytest.mark.parametrize("kind", ["random", "two alike", "all alike", "zero"])
def test_eigenvalues_are_those_of_a_solver(kind: str) -> None:
    a = np.random.default_rng(0).normal(0.0, 1e-3, (6, 200))
    if kind != "random":
        a[3:] = 0.0
        a[1] = a[0]
        a[2] = a[0] if kind != "two alike" else a[2]
    a *= kind != "zero"
    expected = np.linalg.eigvalsh(a.T[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]).T
    assert np.abs(eigenvalues(a) - expected).max() < 1e-10

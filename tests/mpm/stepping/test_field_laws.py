"""Laws of the field: conservation, periodic space, and forces that are given."""

import numpy as np
import pytest
from field_parts import at, block, plate, same, sand, unbalanced

import mpm

G = 9.81


@pytest.mark.long
@pytest.mark.parametrize(("conditions", "precision", "bound"), [
    (("stick", "roller", "friction"), "f64", 1e-12), (("friction",) * 3, "f32", 1e-5),
    *(pytest.param((condition,) * 3, "f64", 1e-12, marks=pytest.mark.slow)
      for condition in ("friction", "roller", "stick"))])
def test_ledger_closes_against_walls(conditions: tuple[str, str, str], precision: str, bound: float) -> None:
    """What the grains gain is gravity and wall impulses and nothing else, linear and angular."""
    thrown = block(sand(nu=0.3), (0, 0, 0), (0.1, 0.14, 0.1), 0.01, (-1.0, -0.5, -0.5), np.random.default_rng(1))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[thrown],
                        walls=mpm.Walls(lower=conditions, upper=conditions), precision=precision)
    assert max(unbalanced(solver, 40, 10 * solver.dt, 2)) <= bound


@pytest.mark.long
@pytest.mark.parametrize("boundary", ["periodic", "roller"])
def test_periodic_sides_repeat_space(boundary: str) -> None:
    """Material that fills space drifts through it unstrained, and what leaves on one side enters on the other."""
    cell, n = 0.05, 8
    positions = mpm.sample_box((0, 0, 0), (n * cell,) * 3, cell / 2)
    velocities = np.tile([3.0, -2.0, 1.0], (len(positions), 1))
    if boundary == "roller":
        velocities[:, 0] = 0.0
    sides = (boundary, "periodic", "periodic")
    material = mpm.Elastic(E=1e5, nu=0.3, density=1000.0)
    body = mpm.Body(material, positions, velocities=velocities, volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (n * cell,) * 3, cell), bodies=[body], gravity=(0, 0, 0),
                        walls=mpm.Walls(lower=sides, upper=sides), precision="f64")
    solver.advance(0.5)
    # the block fills space: it moves on unstrained, wrapped
    expected = np.mod(positions + 0.5 * velocities, n * cell)
    assert np.abs(solver.velocities() - velocities).max() <= 1e-9
    assert np.abs(np.mod(solver.positions() - expected + 1e-6, n * cell) - 1e-6).max() <= 1e-9


def test_periodic_axis_shifts_nothing() -> None:
    """A heap that collapses across the seam does what it does in the middle (f64, to rounding)."""
    cell, ends, sides = 0.02, [], ("periodic", "friction", "friction")
    heap = mpm.sample_box((0, 0, 0), (0.08, 0.08, 0.1), cell / 2)
    for shift in (0.12, 0.28):  # the second lies across the seam at 0.32
        positions = heap + [shift, 0.12, 0.0]
        positions[:, 0] = np.mod(positions[:, 0], 0.32)
        with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.32, 0.32, 0.2), cell), precision="f64",
                        walls=mpm.Walls(lower=sides, upper=sides),
                        bodies=[mpm.Body(sand(), positions, volume=(cell / 2) ** 3)]) as solver:
            solver.advance(0.1)
            moved = solver.positions()
            moved[:, 0] = np.mod(moved[:, 0] - shift + 0.1, 0.32)
            ends.append(moved)
    assert np.abs(ends[0] - ends[1]).max() <= 1e-9


@pytest.mark.long
def test_ledger_closes_with_shell_and_solid_together() -> None:
    """Sand on a plate near the floor, struck by a moving ball: what the grains gain, somebody gave. The last pack,
    beside the plate, has one grain in four lanes."""
    cell = 0.01
    grains = mpm.sample_box((0.06, 0.06, 0.008), (0.14, 0.14, 0.05), cell / 2)[::-1][:-3]
    assert len(grains) % 4 == 1
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.15), cell), precision="f64",
                        bodies=[mpm.Body(sand(), grains, volume=(cell / 2) ** 3)],
                        colliders=[mpm.Collider(mpm.Shell.from_mesh(plate(0.06), 1e-3), pose=at(0.1, 0.1, 0.003)),
                                   mpm.Collider(mpm.Sdf.sphere(0.03), pose=at(0.1, 0.1, 0.085))])

    def lower(step: int) -> None:
        solver.set_collider_motion(1, *(at(0.1, 0.1, 0.085 - 1e-3 * n) for n in (step, step + 1)))

    assert max(unbalanced(solver, 30, 2e-3, 4, lower)) <= 1e-12
    assert solver.positions()[:, 2].min() > 0.003  # all still above the plate, 0.3 cells over the floor


@pytest.mark.long
def test_what_was_near_a_shell_before_is_forgotten() -> None:
    """A shell that has been at a periodic side leaves nothing behind there: grains that cross the side later move as
    they do in a solver that never saw it."""
    cell, ends, sides = 0.01, [], ("periodic", "slip", "slip")
    sheet = mpm.Shell.from_mesh(plate(0.03, axis=0), 1e-3)
    grains = mpm.sample_box((0.225, 0.05, 0.05), (0.235, 0.07, 0.07), cell / 2)
    for there_before in (False, True):
        place = at(0.232 if there_before else 0.12, 0.06, 0.06)
        with mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (0.24, 0.12, 0.12), cell), gravity=(0, 0, 0), precision="f64",
        walls=mpm.Walls(lower=sides, upper=sides), colliders=[mpm.Collider(sheet, friction=0.3, pose=place)],
        bodies=[mpm.Body(mpm.Elastic(E=1e4, nu=0.2, density=1000.0), grains, volume=(cell / 2) ** 3)]) as solver:
            state = solver.state()
            if there_before:
                solver.advance(solver.dt)
            state["x"] += mpm.sample_box((0.0005, 0.05, 0.05), (0.0105, 0.07, 0.07), cell / 2) - grains
            state["v"][:], state["poses"][0, :3] = [0.5, 0, 0], [0.12, 0.06, 0.06]
            solver.load(state)
            solver.advance(4 * solver.dt)
            ends.append(solver.state())
            assert not solver.collider_impulse(0).force.any()
    assert same(*ends)


@pytest.mark.long
def test_the_ledger_is_all_that_grains_are_given() -> None:
    """Its rows are gravity, walls and colliders and nothing else, so that they sum to the change of momentum, also with
    another gravity and another density than the solver was built with."""
    ball = mpm.Collider(mpm.Sdf.sphere(0.03), pose=at(0.08, 0.08, 0.09))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.16,) * 3, 0.02), colliders=[ball], precision="f64",
                        bodies=[block(sand(), (0.04, 0.04, 0.0), (0.12, 0.12, 0.06), 0.01)])
    solver.advance(5e-3)
    solver.set_gravity(np.array([1.0, 0.0, -3.0]))
    solver.set_material(0, sand(density=1800.0))
    assert solver.momentum_after_advance().linear == pytest.approx(solver.momentum().linear, rel=1e-12)
    before = np.concatenate(solver.momentum_after_advance())
    solver.advance(5e-3)
    change = np.concatenate(solver.momentum()) - before
    assert solver.ledger.shape == (3, 6)
    assert solver.ledger.sum(0) == pytest.approx(change, abs=1e-12 * np.abs(solver.ledger).sum())
    assert solver.ledger[0, :3] == pytest.approx(5e-3 * solver.masses().sum() * np.array([1.0, 0.0, -3.0]), rel=1e-12)
    assert solver.energy().potential == pytest.approx(-(solver.masses() @ solver.positions()) @ [1.0, 0.0, -3.0])


@pytest.mark.long
def test_body_acceleration_is_gravity() -> None:
    """The same acceleration given to every grain, and credited to the same row of the ledger."""
    body = block(mpm.Elastic(E=1e5, nu=0.3, density=1000.0), (0.3, 0.3, 0.6), (0.5, 0.5, 0.8), 0.025)
    ends, rows = [], []
    for gravity, given in (((0, 0, -G), None), ((0, 0, 0), np.tile([0.0, 0.0, -G], (len(body.positions), 1)))):
        solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), 0.05), bodies=[body], gravity=gravity, dt=1e-3,
                            body_acceleration=given, precision="f64")
        solver.advance(0.1)
        ends.append(solver.positions())
        rows.append(solver.ledger[0])
    assert np.abs(ends[0] - ends[1]).max() <= 1e-13 and rows[1] == pytest.approx(rows[0], rel=1e-9, abs=1e-12)
    with pytest.raises(mpm.InvalidValue, match=r"body_acceleration = .*accepted: finite numbers, shape"):
        solver.set_body_acceleration(np.zeros((1, 3)))

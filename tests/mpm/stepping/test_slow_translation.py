"""Motion below the resolution of single precision: particles a metre from the origin follow it."""

import numpy as np
import pytest
from field_parts import at, block, plate, same, sand

import mpm
from mpm.rollout.losses import LossGradient, RolloutStates

CELL, DT = 0.02, 2e-4
SPEED = 1e-5  # [m/s]: 2e-9 m in a substep, where single precision resolves 1.2e-7 m


def slow_block(precision: str = "f32", low: float = 0.9, **options) -> tuple[mpm.Solver, np.ndarray]:
    """A block of grains that moves in all directions at `SPEED`, and where its grains begin [m] (n, 3)."""
    body = block(sand(nu=0.3), (low,) * 3, (low + 3 * CELL,) * 3, CELL / 2, (SPEED,) * 3, np.random.default_rng(0))
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (1.2, 1.2, 1.2), CELL), bodies=[body], gravity=(0, 0, 0), dt=DT,
                      precision=precision, **options), body.positions


@pytest.mark.long
def test_grains_beside_a_shell_move() -> None:
    """They are moved one by one. The shell has no friction, and is further away than it pushes."""
    sheet = mpm.Shell.from_mesh(plate(0.1), 1e-3)
    solver, begin = slow_block(colliders=[mpm.Collider(sheet, friction=0.0, pose=at(0.93, 0.93, 0.885))])
    solver.advance(2000 * DT)
    beside = solver.state()["side"][:, 0] != 0
    moved = (solver.positions() - begin)[beside].mean(0)
    assert beside.sum() > 20 and moved == pytest.approx(np.full(3, SPEED * 2000 * DT), rel=0.05)


@pytest.mark.long
def test_a_slow_solid_pushes_grains() -> None:
    """Grains that a moving solid keeps out of itself move with its face."""
    body = block(mpm.Elastic(E=1e4, nu=0.3, density=1000.0), (0.9,) * 3, (0.96,) * 3, CELL / 2)
    wall = mpm.Collider(mpm.Sdf.box((0.02, 0.1, 0.1)), pose=at(0.88, 0.93, 0.93))
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (1.2, 1.2, 1.2), CELL), bodies=[body], colliders=[wall],
                    gravity=(0, 0, 0), dt=DT, precision="f32") as solver:
        solver.set_collider_motion(0, wall.pose, at(0.88 + 2000 * DT * SPEED, 0.93, 0.93))
        solver.advance(2000 * DT)
        moved = (solver.positions() - body.positions)[:, 0].mean()
        assert moved > 0.5 * SPEED * 2000 * DT


def test_a_state_has_the_remainder() -> None:
    """It continues to the bit; without the remainder, as older states are, it is read as zero; f64 has none."""
    solver, _ = slow_block()
    solver.advance(10 * DT)
    stored = solver.state()
    assert np.abs(stored["remainder"]).min() > 0.0
    solver.advance(100 * DT)
    end = solver.state()
    solver.load(stored)
    solver.advance(100 * DT)
    assert same(end, solver.state())
    solver.load({name: values for name, values in stored.items() if name != "remainder"})
    assert not solver.state()["remainder"].any()
    solver.load(stored)
    solver.store_checkpoint()
    solver.advance(10 * DT)
    solver.restore_checkpoint()
    assert (solver.state()["remainder"] == stored["remainder"]).all()
    double, _ = slow_block("f64")
    assert "remainder" not in double.state() and not double.particles.remainder


@pytest.mark.slow
@pytest.mark.parametrize("interval", [0.0, 5 * DT])
def test_rollouts_move_as_the_solver(interval: float) -> None:
    """The forward sweeps, and those that a gradient repeats, end where the solver does, far below a quantum."""
    solver, begin = slow_block(transfer_interval=interval)
    start = solver.state()
    solver.advance(400 * DT)
    end = place(solver)
    solver.load(start)

    def mean_of_x(states: RolloutStates) -> LossGradient:
        here = (states.steps == 40)[:, None, None] / states.x[0].size
        return LossGradient(float(np.sum(here * states.x)), x=here * np.ones(states.x.shape))

    roll = mpm.Rollout(solver, 40, step_dt=10 * DT, substeps=10)
    for run in (roll.value, roll.value_and_grad):
        run(None, None, mean_of_x)
        assert np.abs(place(solver) - end).max() <= 1e-4 * max(solver.fields.quantum)
    assert (place(solver) - begin + solver.grid.origin).mean() == pytest.approx(SPEED * 400 * DT, rel=0.01)


def place(solver: mpm.Solver) -> np.ndarray:
    """Return positions with their remainder [m] (n, 3)."""
    state = solver.state()
    return state["x"].astype(float) + state["remainder"]

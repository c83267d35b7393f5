"""An advance that fails leaves the solver where it stood: after divergence, Ctrl-C and refusals alike."""

import signal
import threading

import numpy as np
import pytest
from field_parts import at, block, same, sand

import mpm


def make(mobile: bool = False) -> mpm.Solver:
    """Sand with a ball above it, after a first advance."""
    ball = mpm.Collider(mpm.Sdf.sphere(0.03), mobile=mobile, pose=at(0.1, 0.1, 0.092))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), colliders=[ball],
                        bodies=[block(sand(E=1.5e5), (0.04, 0.04, 0.0), (0.16, 0.16, 0.06), 0.01)])
    drive(solver)
    solver.advance(0.01)
    return solver


def drive(solver: mpm.Solver) -> None:
    """Let the ball come down in the next advance."""
    if solver.features.mobile:
        solver.set_collider_mobility(0, np.diag([10.0, 10.0, 10.0, 1e3, 1e3, 1e3]), np.array([0, 0, -0.3, 0, 0, 0.0]))
    else:
        here = solver.collider_pose(0)
        solver.set_collider_motion(0, here, mpm.Pose(here.position - [0, 0, 2e-3], here.quaternion))


def fail(solver: mpm.Solver) -> None:
    """Let an advance diverge: one particle is far too fast."""
    bad = solver.state()
    bad["v"][3] = 1e5
    solver.load(bad)
    drive(solver)
    with pytest.raises(mpm.SimulationDiverged):
        solver.advance(0.01)


def standing(solver: mpm.Solver) -> dict[str, np.ndarray]:
    """All that a failed advance must leave alone."""
    return solver.state() | {"ledger": solver.ledger.copy(), "momentum": np.array(solver.momentum_after_advance()),
                             "substep": np.array(solver.substep)}


@pytest.mark.long
@pytest.mark.parametrize("velocity", [(0, 0, -1e4), (1e30, 0, 0)], ids=["fast", "infinite"])
def test_divergence_is_found_in_its_substep_and_undone(velocity):
    with make() as solver:
        bad = solver.state()
        bad["v"][7] = velocity
        solver.load(bad)
        before = standing(solver)
        with pytest.raises(mpm.SimulationDiverged) as caught:
            solver.advance(0.05)
        error = caught.value
        assert error.step == before["steps"] + 1 and error.time == pytest.approx(before["time"] + solver.dt, rel=0.1)
        assert error.diagnostics.mass == pytest.approx(solver.masses().sum())
        assert same(standing(solver), before)
        assert error.state["steps"] == error.step and not np.array_equal(error.state["x"], before["x"])


@pytest.mark.long
@pytest.mark.parametrize("mobile", [False, True], ids=["driven", "mobile"])
def test_a_solver_goes_on_after_a_failed_advance_as_if_there_had_been_none(mobile):
    with make(mobile) as solver:
        good = solver.state()
        drive(solver)
        solver.advance(0.01)
        wanted = standing(solver)
        solver.load(good)
        fail(solver)
        solver.load(good)
        drive(solver)
        solver.advance(0.01)
        assert same(standing(solver), wanted)


@pytest.mark.parametrize("mobile", [False, True], ids=["driven", "mobile"])
def test_ctrl_c_undoes_the_advance(mobile):
    with make(mobile) as solver:
        drive(solver)
        before, pose = standing(solver), solver.collider_pose(0)
        for k in range(3):
            threading.Timer(0.1 + 0.05 * k, signal.raise_signal, [signal.SIGINT]).start()
            with pytest.raises(KeyboardInterrupt):
                solver.advance(1000.0)
            assert same(standing(solver), before) and np.array_equal(solver.collider_pose(0).position, pose.position)


def test_a_checkpoint_survives_a_failed_advance():
    with make(mobile=True) as solver:
        solver.store_checkpoint()
        before = standing(solver)
        drive(solver)
        solver.advance(0.01)
        fail(solver)
        solver.restore_checkpoint()
        assert same(solver.state(), {name: before[name] for name in solver.state()})

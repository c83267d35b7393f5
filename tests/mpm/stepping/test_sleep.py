"""Sleeping: who sleeps costs nothing and takes nothing away, wakes when something comes, and is saved to the bit."""

import numpy as np
import pytest
import trimesh
from field_parts import UPRIGHT, same, sand

import mpm
from mpm.state.sleepers import FORCE, MASS

CELL = 0.01
SAND = sand(E=1.5e5)
WATER = mpm.NewtonianFluid(bulk_modulus=1.5e5, density=1000.0, viscosity=1.0)
BALL = mpm.Sdf.sphere(0.02)
HIGH, LOW = np.array([0.04, 0.04, 0.20]), np.array([0.04, 0.04, 0.06])


def bed(height: float = 0.03, x: tuple[float, float] = (0.0, 0.16)) -> np.ndarray:
    """Positions [m] (n, 3) of a bed from wall to wall."""
    return mpm.sample_box((x[0], 0.0, 0.0), (x[1], 0.08, height), CELL / 2)


def make(colliders: list[mpm.Collider] | None = None, sleep: bool | float = True, positions: np.ndarray | None = None,
         **options) -> mpm.Solver:
    """A bed of sand in a box, in double precision."""
    box = mpm.Grid((0, 0, 0), options.pop("upper", (0.16, 0.08, 0.24)), CELL)
    bodies = options.pop("bodies", None) or [mpm.Body(SAND, bed() if positions is None else positions, volume=1.25e-7)]
    return mpm.Solver(**{"grid": box, "bodies": bodies, "colliders": colliders, "precision": "f64", "sleep": sleep,
                         "walls": mpm.Walls(friction=0.5)} | options)


def settle(solver: mpm.Solver, share: float = 0.02, within: float = 4.0) -> None:
    """Advance until at most a share of the particles is awake; those that lie deep oscillate longest."""
    while solver.awake.mean() > share:
        assert solver.time < within, f"{solver.awake.mean():.3f} awake after {solver.time:.2f} s"
        solver.advance(0.02)


def unbalanced(solver: mpm.Solver, before: np.ndarray) -> np.ndarray:
    """What the last advance's change of momentum (6,) lacks in the ledger, of the largest entry of the ledger."""
    change = np.concatenate(solver.momentum_after_advance()) - before
    given = solver.ledger.sum(0) + np.concatenate(solver.sleepers_impulse)
    return np.abs(change - given) / np.abs(solver.ledger).max()


def lower(solver: mpm.Solver, distance: float, duration: float = 0.02) -> None:
    """Move collider 0 down in an advance; the first time, from 1 cm above the bed."""
    here = solver.collider_pose(0).position
    here = LOW if here[2] > LOW[2] else here
    solver.set_collider_motion(0, mpm.Pose(here, UPRIGHT), mpm.Pose(here - [0, 0, distance], UPRIGHT), jump=True)
    solver.advance(duration)


@pytest.fixture(scope="module")
def asleep() -> mpm.Solver:
    """A bed that sleeps as a whole, below a ball that is high above it."""
    solver = make([mpm.Collider(BALL, pose=mpm.Pose(HIGH, UPRIGHT), friction=0.3)])
    settle(solver, share=0.0)
    return solver


@pytest.fixture
def sleeping(asleep: mpm.Solver) -> mpm.Solver:
    if not hasattr(asleep, "kept"):
        asleep.kept = asleep.state()
    asleep.load(asleep.kept)
    return asleep


@pytest.mark.long
def test_a_bed_at_rest_falls_asleep_and_touches_no_node(sleeping: mpm.Solver) -> None:
    before = sleeping.state()
    sleeping.advance(0.02)
    assert not sleeping.awake.any() and sleeping.fields.sleepers.count[None] == 0
    assert sleeping.fields.grid.count[None] == 0, "no block of nodes is active"
    assert all(np.array_equal(before[name], value) for name, value in sleeping.state().items()
               if name not in ("time", "steps"))
    assert not sleeping.velocities().any() and not np.any(sleeping.ledger)


def test_a_bed_that_sleeps_is_not_launched_until_something_is_set(sleeping: mpm.Solver) -> None:
    sleeping.advance(0.02)
    before, launches, steps = sleeping.state(), sleeping.loop.launches, sleeping.steps
    sleeping.advance(0.02)
    assert sleeping.loop.launches == launches and sleeping.time == pytest.approx(before["time"] + 0.02)
    assert sleeping.steps - steps == np.ceil(0.02 / sleeping.dt) and not np.any(sleeping.ledger)
    for change in (lambda: sleeping.set_gravity(np.array([0.1, 0.0, -9.81])), lambda: lower(sleeping, 1e-3, 1e-3)):
        change()
        sleeping.advance(1e-3)
        assert sleeping.loop.launches > launches and sleeping.awake.any()
        launches = sleeping.loop.launches
    sleeping.set_gravity(np.array([0.0, 0.0, -9.81]))


def test_sleepers_give_the_nodes_their_mass_and_no_force_in_sum(sleeping: mpm.Solver) -> None:
    sleeping.advance(0.002)
    sums = sleeping.fields.sleepers.sums.to_numpy().astype(float).reshape(-1, 4)
    force, mass = sleeping.fields.sleepers.limits.to_numpy()[[FORCE, MASS]]
    assert sums[:, 3].sum() * mass == pytest.approx(sleeping.masses().sum(), rel=1e-10)
    assert abs(sums[:, :3].sum(0)).max() < 1e-9 * abs(sums[:, :3]).sum()
    weight = sleeping.masses().sum() * 9.81
    assert abs(sums[:, 2]).sum() * force > weight, "the bed carries itself"


def test_what_wakes_leaves_nothing_behind(sleeping: mpm.Solver) -> None:
    sleeping.advance(0.002)
    assert sleeping.fields.sleepers.sums.to_numpy().any()
    for _ in range(20):  # into the bed, until the last sleeper is awake
        lower(sleeping, 0.0025, duration=0.01)
    sleeping.set_gravity(np.array([0.0, 0.0, -9.81]))
    sleeping.advance(0.002)
    assert sleeping.awake.all()
    sleepers = sleeping.fields.sleepers
    assert not sleepers.sums.to_numpy().any() and not sleepers.stencil_count.to_numpy().any()


def test_a_collider_wakes_what_is_near_and_leaves_alone_what_is_far(sleeping: mpm.Solver) -> None:
    before = sleeping.positions()
    lower(sleeping, 0.002)
    awake, away = sleeping.awake, np.linalg.norm(before - sleeping.collider_pose(0).position, axis=1) - 0.02
    assert awake[away < 2.5 * CELL].all(), "whatever shares a node with contact"
    assert not awake.all() and np.array_equal(before[~awake], sleeping.positions()[~awake])


def test_a_state_goes_on_to_the_bit_and_a_failed_advance_is_undone(sleeping: mpm.Solver) -> None:
    for _ in range(10):
        lower(sleeping, 0.003)
    assert 0 < sleeping.awake.mean() < 1
    state = sleeping.state()
    lower(sleeping, 0.003)
    ahead = sleeping.state()
    sleeping.load(state)
    lower(sleeping, 0.003)
    assert same(sleeping.state(), ahead)
    sleeping.load(state)
    with pytest.raises(mpm.ColliderTooFast):
        lower(sleeping, 1e6)
    lower(sleeping, 0.003)
    assert same(sleeping.state(), ahead)
    wild = {name: value.copy() for name, value in state.items()}
    wild["v"][np.flatnonzero(state["rest"][:, 0] == 0.0)[0], 0] = 1e5
    sleeping.load(wild)
    with pytest.raises(mpm.SimulationDiverged):
        sleeping.advance(0.02)
    sleeping.load(state)
    lower(sleeping, 0.003)
    assert same(sleeping.state(), ahead)


SIDES = ("periodic", "friction", "friction")
HUMP = np.array([0.08, 0.04, 0.0])
SCENES = {"walls": {}, "strides of one substep": {"transfer_interval": 0.0},
          "moving solid": {"colliders": [mpm.Collider(BALL, pose=mpm.Pose(HIGH, UPRIGHT), friction=0.3)]},
          "static solid": {"colliders": [mpm.Collider(BALL, pose=mpm.Pose(HUMP, UPRIGHT), static=True)],
                           "positions": bed()[np.linalg.norm(bed() - HUMP, axis=1) > 0.022]},
          "shell": {"colliders": [mpm.Collider(mpm.Shell.from_mesh(trimesh.creation.icosphere(2, 0.02), 1e-3),
                                               friction=0.3, pose=mpm.Pose(HIGH, UPRIGHT))]},
          "mobile solid": {"colliders": [mpm.Collider(BALL, pose=mpm.Pose(LOW, UPRIGHT), friction=0.3, mobile=True)]},
          "periodic sides": {"walls": mpm.Walls(lower=SIDES, upper=SIDES, friction=0.5), "upper": (0.32, 0.08, 0.24),
                             "positions": bed(0.03, (0.0, 0.32))},
          "two laws": {"bodies": [mpm.Body(SAND, bed(0.03, (0.0, 0.08)), volume=1.25e-7),
                                  mpm.Body(WATER, bed(0.03, (0.08, 0.16)), volume=1.25e-7)]}}


def test_sleepers_that_a_loaded_state_gives_a_velocity_are_awake(sleeping: mpm.Solver) -> None:
    state = sleeping.state()
    top = state["x"][:, 2] > state["x"][:, 2].max() - CELL / 4
    state["v"][top, 2] = 0.2
    sleeping.load(state)
    sleeping.advance(5e-3)
    risen = sleeping.state()["x"][:, 2] - state["x"][:, 2]
    assert top.sum() > 100 and risen[top].min() > 2e-4
    assert sleeping.awake[top].all()


@pytest.mark.long
@pytest.mark.parametrize("name", [name if name == "moving solid" else
                                  pytest.param(name, marks=pytest.mark.slow) for name in SCENES])
def test_the_ledger_closes_while_particles_fall_asleep_and_wake(name: str) -> None:
    """Momentum, linear and angular, changes by what the ledger has, with the row of the sleepers."""
    solver, worst, fewest = make(**SCENES[name]), 0.0, 1.0
    for k in range(45):
        before = np.concatenate(solver.momentum_after_advance())
        if solver.features.mobile:
            solver.set_collider_mobility(0, np.diag([20.0, 20.0, 20.0, 1e4, 1e4, 1e4]),
                                         np.array([0, 0, -0.3 if k > 22 else 0.0, 0, 0, 0]))
            solver.advance(0.02)
        elif solver.features.moving_colliders and k > 22:
            lower(solver, 0.001)
        else:
            solver.advance(0.02)
        if np.abs(solver.ledger).max() > 0:
            # what passes a periodic side has another arm on the other
            rows = slice(0, 3 if any(solver.features.periodic) else 6)
            worst = max(worst, unbalanced(solver, before)[rows].max())
        fewest = min(fewest, solver.awake.mean())
    assert worst < 1e-11
    assert fewest < 0.95, "some slept"


@pytest.mark.slow
@pytest.mark.parametrize("cells", [8, 9, 10, 11])
def test_beds_rest_on_upper_walls_as_on_lower_ones(cells: int) -> None:
    """Where the wall's plane, its ghosts and their mirror nodes lie in two blocks, sleepers must count in both."""
    height = cells * CELL
    fallen = []
    for pull, positions in ((-9.81, bed(0.03)), (9.81, bed(0.03) + [0, 0, height - 0.03])):
        ball = mpm.Pose(np.array([0.04, 0.04, 0.5 * (height - np.sign(pull) * 0.04)]), UPRIGHT)
        solver = make(positions=positions, upper=(0.16, 0.08, height), gravity=(0, 0, pull),
                      colliders=[mpm.Collider(mpm.Sdf.sphere(0.01), pose=ball)])
        solver.advance(0.6)
        assert 0 < solver.awake.mean() < 0.95, "asleep in part: the ball keeps those near it awake"
        fallen.append(np.sign(-pull) * (solver.positions()[:, 2] - positions[:, 2]))
    assert fallen[0].mean() == pytest.approx(fallen[1].mean(), abs=2e-6) and abs(fallen[0]).max() < 0.002


@pytest.mark.slow
def test_environments_of_a_batch_sleep_each_for_itself(sleeping: mpm.Solver) -> None:
    batch = mpm.Batch(sleeping, 2)
    for _ in range(8):
        here = batch.collider_pose(1, 0).position
        here = LOW if here[2] > LOW[2] else here
        end = mpm.Pose(here - [0, 0, 0.003], UPRIGHT)
        batch.set_collider_motion(1, 0, mpm.Pose(here, UPRIGHT), end, jump=True)
        batch.advance(np.array([0.02, 0.02]), np.array([1, 1]))
    batch.select(0)
    assert not sleeping.awake.any()
    batch.select(1)
    disturbed = sleeping.positions()
    assert 0 < sleeping.awake.mean() < 1
    sleeping.load(sleeping.kept)
    for _ in range(8):
        lower(sleeping, 0.003)
    assert np.array_equal(disturbed, sleeping.positions()), "as one solver alone, to the bit"


@pytest.mark.parametrize("sleep", [-1.0, 0, "yes", 1e3, np.nan, None])
def test_other_values_are_refused_by_name(sleep) -> None:
    with pytest.raises(mpm.InvalidValue, match="sleep"):
        make(sleep=sleep)


def test_what_cannot_sleep_says_so() -> None:
    solver = make()
    with pytest.raises(mpm.InvalidValue, match="sleep"):
        mpm.Rollout(solver, 2)
    with pytest.raises(mpm.InvalidValue, match="sleep"):
        make(body_acceleration=np.zeros((len(bed()), 3)))

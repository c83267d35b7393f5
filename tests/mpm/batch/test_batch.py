"""Futures that share a solver's fields are those that the solver has alone, to the bit."""

import numpy as np
import pytest
from exact_sums import compare_exactly
from field_parts import at, block, sand

import mpm

CELL = 0.02
STEP = 5e-3
ASIDE = mpm.Pose(np.array([0.02, -0.01, 0.0]), np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)]))
SALT, SOFT = sand(density=1200.0), sand(E=4e4, nu=0.3, density=900.0, friction_angle_deg=25.0)


def scene() -> mpm.Solver:
    """A box among falling grains, watched by a counter and a sample."""
    salt = block(SALT, (0.1, 0.1, 0.06), (0.3, 0.3, 0.14), CELL / 2, rng=np.random.default_rng(0))
    box = mpm.Collider(mpm.Sdf.box((0.04, 0.04, 0.02)), friction=0.2, pose=at(0.2, 0.2, 0.03))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.4, 0.4, 0.4), CELL), colliders=[box], dt=5e-4, bodies=[salt])
    chosen = np.arange(2, len(salt.positions), 3)
    counter = mpm.RegionCounter(solver, chosen, point=np.array([0.3, 0.2, 0.1]), weights=np.ones(3), reach=0.03,
                                per_particle=True, index=0,
                                region=mpm.Region((0.3, 0.2, 0.0), (0.1, 0.08, 9.0), round=True),
                                bounds=mpm.Region((0.2, 0.2, 0.55), (9.0, 9.0, 0.5)),
                                inner=mpm.Region((0.0, 0.0, 0.05), (0.06, 0.05, 0.05)))
    solver.attach(counter, mpm.Sample(solver, chosen))
    return solver


def starts(solver: mpm.Solver) -> list[dict[str, np.ndarray]]:
    """The scene's, one that moves, one in another place."""
    moving, aside = solver.state(), solver.state()
    moving["v"] = moving["v"] + [0.1, 0.0, 0.2]
    aside["x"] = aside["x"] + [0.03, -0.02, 0.0]
    return [solver.state(), moving, aside]


def way(begin: mpm.Pose, e: int, legs: int) -> list[mpm.Pose]:
    """Poses that the box passes, others for each future."""
    return [mpm.Pose(begin.position + k * np.array([0.002, 0.001 * e, 0.003]), begin.quaternion)
            for k in range(legs + 1)]


def same(one: mpm.Counts, other: mpm.Counts) -> bool:
    return one[:-1] == other[:-1] and np.array_equal(one.per_particle, other.per_particle)


def set_up(batch: mpm.Batch, e: int, law: mpm.DruckerPrager, volume: float, frame: mpm.Pose, friction: float) -> None:
    batch.set_material(e, 0, law)
    batch.set_volume(e, 0, volume)
    batch.place(e, frame)
    batch.set_friction(e, 0, friction)


@pytest.fixture(scope="module")
def batch() -> mpm.Batch:
    """Three futures, up to four readings in an advance: one kernel for all tests."""
    return mpm.Batch(scene(), 3, readings=4)


@pytest.mark.long
def test_futures_are_those_of_the_solver_alone() -> None:
    compare_exactly("test_batch")


def compared() -> None:
    """Three starts, motions and numbers of steps, with other materials, volumes and places; two advances and a rest."""
    batch = mpm.Batch(scene(), 3, readings=4)
    alone, materials, legs = scene(), (SALT, SOFT, SALT), (3, 2, 4)
    volumes = [factor * (CELL / 2) ** 3 for factor in (1.0, 0.8, 1.1)]
    frictions = (0.2, 0.0, 0.4)
    frames = (mpm.Pose.identity(), ASIDE, ASIDE)
    expected = []
    for e, start in enumerate(starts(alone)):
        alone.load(start)
        alone.set_material(0, materials[e])
        alone.settings.set_volume(0, volumes[e])
        alone.set_friction(0, frictions[e])
        alone.counter.place(frames[e])
        alone.counter.restart()
        read = [alone.counter.read()]
        for k in (legs[e], 1):
            alone.set_collider_motion(0, *way(alone.collider_pose(0), e, k))
            read += alone.advance(k * STEP, readings=k)
        expected.append((read, alone.state(), alone.core.sample.values.copy()))
    shared, read = batch.solver, []
    for e, start in enumerate(starts(shared)):
        set_up(batch, e, materials[e], volumes[e], frames[e], frictions[e])
        read.append([batch.load(e, start)])
    for counts in (np.array(legs), np.ones(3, int), np.zeros(3, int)):
        for e, k in enumerate(counts):
            if k:
                batch.set_collider_motion(e, 0, *way(batch.collider_pose(e, 0), e, k))
        for row, new in zip(read, batch.advance(counts * STEP, counts)):
            row += new
    for e, (counts, state, sampled) in enumerate(expected):
        assert len(counts) == len(read[e]) and all(map(same, counts, read[e]))
        assert np.array_equal(batch.sampled(e), sampled)
        batch.select(e)
        assert shared.fields.parameters.frictions[0] == pytest.approx(frictions[e])
        assert shared.masses().sum() == pytest.approx(len(shared.masses()) * materials[e].density * volumes[e])
        assert all(np.array_equal(shared.state()[name], values) for name, values in state.items() if name != "time")
        assert shared.time == pytest.approx(float(state["time"]), rel=1e-9)
        assert shared.momentum_after_advance().linear == pytest.approx(shared.momentum().linear, rel=1e-9)


@pytest.mark.long
def test_a_future_that_diverges_ends_alone(batch: mpm.Batch) -> None:
    """One grain of the second is too fast: that one says so, the others read what they read without it."""
    good = scene().state()
    bad = good | {"v": good["v"].copy()}
    bad["v"][7] = 1e30
    for e in range(3):
        batch.load(e, good)
    expected = batch.advance(np.full(3, STEP), np.ones(3, int))
    for e, start in enumerate((good, bad, good)):
        batch.load(e, start)
    read = batch.advance(np.full(3, STEP), np.ones(3, int))
    assert isinstance(read[1], mpm.SimulationDiverged) and "speed nan" in str(read[1])
    for e in (0, 2):
        assert isinstance(read[e], list) and same(read[e][0], expected[e][0])
    for e in range(3):  # and begins anew
        batch.load(e, good)
    for mine, theirs in zip(batch.advance(np.full(3, STEP), np.ones(3, int)), expected):
        assert isinstance(mine, list) and same(mine[0], theirs[0])


@pytest.mark.long
def test_a_future_costs_its_grains_alone(batch: mpm.Batch) -> None:
    """Position, velocity, affine velocity and strain in single precision, 21 numbers a grain, and what is read."""
    grains = sum(batch.solver.particles.counts)
    assert 21 * 4 * grains < batch.bytes_each < 180 * grains


@pytest.mark.long
def test_wrong_batches_are_refused(batch: mpm.Batch) -> None:
    with pytest.raises(mpm.InvalidValue, match="n = 0"):
        mpm.Batch(batch.solver, 0)
    with pytest.raises(mpm.InvalidValue, match="1 to 4, the batch"):
        batch.advance(np.full(3, STEP), np.full(3, 5))
    with pytest.raises(mpm.TimeStepTooLarge):
        batch.set_material(0, 0, sand(E=1e9, density=1200.0))
    with pytest.raises(mpm.InvalidValue, match="volume"):
        batch.set_volume(0, 0, -1.0)
    box = mpm.Collider(mpm.Sdf.box((0.04, 0.04, 0.02)), mobile=True)
    pushed = mpm.Solver(grid=batch.solver.grid, colliders=[box], bodies=batch.solver.bodies)
    with pytest.raises(mpm.InvalidValue, match="mobile"):
        mpm.Batch(pushed, 1)

"""Counts taken in a launch, against plain numpy on the copied state."""

from itertools import pairwise

import numpy as np
import pytest
from field_parts import at, block, plate, sand

import mpm

CELL = 0.02
REGION = mpm.Region((0.3, 0.2, 0.0), (0.1, 0.08, 9.0), round=True)
BOUNDS = mpm.Region((0.2, 0.2, 0.55), (9.0, 9.0, 0.5))
INNER = mpm.Region((0.0, 0.0, 0.05), (0.06, 0.05, 0.05))
POINT, WEIGHTS = np.array([0.3, 0.2, 0.1]), np.array([1.0, 1.0, 0.5])


def scene(every: int = 3, mobile: bool = False, **options: object) -> tuple[mpm.Solver, mpm.RegionCounter, np.ndarray]:
    """A box that moves through falling particles, of which every third is counted."""
    salt = block(sand(density=1200.0), (0.1, 0.1, 0.06), (0.3, 0.3, 0.2), CELL / 2, rng=np.random.default_rng(0))
    box = mpm.Collider(mpm.Sdf.box((0.04, 0.04, 0.02)), friction=0.2, mobile=mobile, pose=at(0.2, 0.2, 0.03))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.4, 0.4, 0.4), CELL), colliders=[box], dt=5e-4, bodies=[salt])
    chosen = np.arange(every - 1, len(salt.positions), every)
    counter = mpm.RegionCounter(solver, chosen, point=POINT, weights=WEIGHTS, region=REGION, bounds=BOUNDS, inner=INNER,
                      index=0, **options)
    return solver, counter, chosen


class Reference:
    """The same readings, slowly."""

    def __init__(self, solver: mpm.Solver, chosen: np.ndarray) -> None:
        self.solver, self.chosen = solver, chosen
        self.exited = self.was_in_region = np.zeros(len(chosen), bool)
        self.read()

    def read(self) -> tuple[float, int, int, int, int, int]:
        x = self.solver.positions()[self.chosen]
        in_region = REGION.holds(x)
        in_inner = INNER.holds(self.solver.collider_pose(0).inverse().apply(x))
        newly = ~self.exited & ~in_inner & ~BOUNDS.holds(x)
        values = (float((WEIGHTS * np.abs(x - POINT)).sum()), int(newly.sum()), int((newly & self.was_in_region).sum()),
                  int(in_region.sum()), int((self.exited | newly).sum()), int(in_inner.sum()))
        self.exited, self.was_in_region = self.exited | newly, in_region
        return values


def moved(pose: mpm.Pose) -> mpm.Pose:
    return mpm.Pose(pose.position + [0.002, 0.001, 0.003], pose.quaternion)


@pytest.mark.long
def test_readings_agree_with_numpy_and_with_those_of_an_advance() -> None:
    """Ten readings, one after each of ten advances, and ten within one advance along the same path."""
    solver, counter, chosen = scene(per_particle=True, reach=0.03)
    reference = Reference(solver, chosen)
    counter.restart()
    read, path = [], [solver.collider_pose(0)]
    for _ in range(10):
        path.append(moved(path[-1]))
        solver.set_collider_motion(0, *path[-2:])
        solver.advance(5e-3)
        read.append(counter.read())
        expected = reference.read()
        assert read[-1][:6] == pytest.approx(expected, rel=1e-9, abs=1e-12)
        x = solver.positions()
        per_particle = read[-1].per_particle
        assert per_particle[:, 0] == pytest.approx(WEIGHTS @ np.abs(x[chosen] - POINT).T, rel=1e-6)
        assert (per_particle[:, 1] > 0).tolist() == REGION.holds(x[chosen]).tolist()
        phi = solver.colliders[0].sdf.distance(solver.collider_pose(0).inverse().apply(x))
        assert read[-1].near == (phi < 0.03).sum() > 0
    assert sum(r.newly_exited for r in read) == read[-1].exited > 5 and sum(r.exited_from_region for r in read) > 0
    solver.close()  # the next one takes its fields
    solver, counter, chosen = scene(per_particle=True, reach=0.03)
    sample = mpm.Sample(solver, chosen)
    solver.attach(counter, sample)  # another kernel, which may round otherwise
    counter.restart()
    start, single = solver.state(), []
    for leg in pairwise(path):
        solver.set_collider_motion(0, *leg)
        single += solver.advance(5e-3, readings=1)
    places = solver.positions()
    for now, before in zip(single, read, strict=True):
        assert now[1:-1] == before[1:-1] and now.distance == pytest.approx(before.distance, rel=1e-8)
    solver.load(start)
    counter.restart()
    solver.set_collider_motion(0, *path)
    for now, before in zip(solver.advance(5e-2, readings=10), single, strict=True):
        assert now[:-1] == before[:-1] and np.array_equal(now.per_particle, before.per_particle)
    assert np.array_equal(solver.positions(), places)
    assert sample.values[:, :3] == pytest.approx(places[chosen], abs=1e-6)
    assert sample.values[:, 3:] == pytest.approx(solver.velocities()[chosen], abs=1e-6)


@pytest.mark.long
def test_readings_of_a_step_that_is_rolled_back_are_not_counted_twice() -> None:
    """A tool that contact moves: flags of particles return with their state."""
    solver, counter, _ = scene(mobile=True, per_particle=True)
    solver.attach(counter)
    solver.set_collider_mobility(0, np.zeros((6, 6)), np.zeros(6))
    state = solver.state()
    state["v"] = state["v"] + [2.0, 0.0, -1.0]
    solver.load(state)
    counter.restart()
    solver.advance(0.02)
    for change in (lambda: None, counter.read):
        solver.store_checkpoint()
        change()  # a reading in between is rolled back, too
        first = solver.advance(0.02)[0]
        solver.restore_checkpoint()
        again = solver.advance(0.02)[0]
        if change is not counter.read:
            assert first[:-1] == again[:-1] and first.newly_exited > 0
        solver.restore_checkpoint()
        assert counter.read().exited < again.exited


def test_points_near_the_probe_are_counted() -> None:
    points = np.array([[0.2, 0.2, 0.055], [0.2, 0.2, 0.06], [0.26, 0.2, 0.03], [0.0, 0.0, 0.0]])
    solver, counter, _ = scene(points=points, probe=mpm.Sdf.box((0.04, 0.04, 0.02)), margin=0.0075)
    now = counter.read()
    phi = solver.colliders[0].sdf.distance(points - [0.2, 0.2, 0.03])
    assert now.probed == (phi < 0.0075).sum() == 1 and now.clearance == pytest.approx(phi.min(), abs=1e-6)


def test_a_counter_that_is_placed_counts_what_lies_as_before_in_its_frame() -> None:
    """Turned and displaced; distances are measured along the world's axes from where the point then is."""
    points = np.array([[0.2, 0.2, 0.055], [0.26, 0.2, 0.03], [0.0, 0.0, 0.0]])
    solver, counter, chosen = scene(points=points, probe=mpm.Sdf.box((0.04, 0.04, 0.02)), margin=0.0075)
    frame = mpm.Pose(np.array([0.05, -0.1, 0.02]), np.array([np.cos(0.2), 0.0, 0.0, np.sin(0.2)]))
    before = counter.read()
    counter.place(frame)
    counter.restart()
    now, x = counter.read(), solver.positions()[chosen]
    assert now.in_region == REGION.holds(frame.inverse().apply(x)).sum() != before.in_region > 0
    assert now.exited == (~BOUNDS.holds(frame.inverse().apply(x))
                          & ~INNER.holds(solver.collider_pose(0).inverse().apply(x))).sum()
    assert now.distance == pytest.approx((WEIGHTS * np.abs(x - frame.apply(POINT[None]))).sum(), rel=1e-9)
    phi = solver.colliders[0].sdf.distance(frame.apply(points) - [0.2, 0.2, 0.03])
    assert (now.probed, now.clearance) == ((phi < 0.0075).sum(), pytest.approx(phi.min(), abs=1e-6))
    counter.place(mpm.Pose.identity())
    counter.restart()
    assert counter.read()[:-1] == before[:-1]
    with pytest.raises(mpm.InvalidValue, match="pose"):
        counter.place(mpm.Pose(np.full(3, np.nan), np.ones(4)))


def test_numbers_of_readings_are_checked() -> None:
    solver, _, _ = scene()
    with pytest.raises(mpm.InvalidValue, match="readings = 0; accepted: 1 to 64"):
        solver.advance(1e-3, readings=0)


def test_grains_on_both_sides_of_a_shell_are_near() -> None:
    """Within a reach of the faces of a plate of 4 mm, up to its rim."""
    salt = block(sand(density=1200.0), (0.1, 0.1, 0.06), (0.3, 0.3, 0.3), CELL / 2, rng=np.random.default_rng(0))
    pose = at(0.2, 0.2, 0.17)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.4, 0.4, 0.4), CELL), dt=5e-4, bodies=[salt],
                        colliders=[mpm.Collider(mpm.Shell.from_mesh(plate(0.05), 4e-3), friction=0.2, pose=pose)])
    counter = mpm.RegionCounter(solver, np.arange(5), point=POINT, weights=WEIGHTS, region=REGION, bounds=BOUNDS,
                                inner=INNER, index=0, reach=0.008)
    y = solver.positions() - pose.position
    away = np.linalg.norm(np.maximum(np.abs(y) - [0.05, 0.05, 0.0], 0.0), axis=1)
    error = 3e-4  # of distances in the shell's lattice, beside its edge
    assert 100 < (away < 0.01 - error).sum() <= counter.read().near <= (away < 0.01 + error).sum()

"""What is read of the grains in a launch, against plain numpy on the copied state."""

import numpy as np
import pytest

import mpm

CELL = 0.02
TARGET = mpm.Region((0.3, 0.2, 0.0), (0.1, 0.08, 9.0), round=True)
BOUNDS = mpm.Region((0.2, 0.2, 0.55), (9.0, 9.0, 0.5))
INTERIOR = mpm.Region((0.0, 0.0, 0.05), (0.06, 0.05, 0.05))
GOAL, WEIGHTS = np.array([0.3, 0.2, 0.1]), np.array([1.0, 1.0, 0.5])


def scene(every: int = 3, mobile: bool = False, **options: object) -> tuple[mpm.Solver, mpm.Tally, np.ndarray]:
    """A box that moves through falling grains, of which every third is counted."""
    salt = mpm.DruckerPrager(E=1e5, nu=0.2, density=1200.0, friction_angle_deg=30.0)
    positions = mpm.sample_box((0.1, 0.1, 0.06), (0.3, 0.3, 0.2), CELL / 2, np.random.default_rng(0))
    box = mpm.Collider(mpm.Sdf.box((0.04, 0.04, 0.02)), friction=0.2, mobile=mobile,
                       pose=mpm.Pose(np.array([0.2, 0.2, 0.03]), np.array([1.0, 0.0, 0.0, 0.0])))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.4, 0.4, 0.4), CELL), colliders=[box], dt=5e-4,
                        bodies=[mpm.Body(salt, positions, volume=(CELL / 2) ** 3)])
    chosen = np.arange(every - 1, len(positions), every)
    tally = mpm.Tally(solver, chosen, goal=GOAL, weights=WEIGHTS, target=TARGET, bounds=BOUNDS, interior=INTERIOR,
                      tool=0, **options)
    return solver, tally, chosen


class Reference:
    """The same readings, slowly."""

    def __init__(self, solver: mpm.Solver, chosen: np.ndarray) -> None:
        self.solver, self.chosen = solver, chosen
        self.lost = self.was_on_target = np.zeros(len(chosen), bool)
        self.read()

    def read(self) -> tuple[float, int, int, int, int, int]:
        x = self.solver.positions()[self.chosen]
        on_target = TARGET.holds(x)
        held = INTERIOR.holds(self.solver.collider_pose(0).inverse().apply(x))
        newly = ~self.lost & ~held & ~BOUNDS.holds(x)
        values = (float((WEIGHTS * np.abs(x - GOAL)).sum()), int(newly.sum()), int((newly & self.was_on_target).sum()),
                  int(on_target.sum()), int((self.lost | newly).sum()), int(held.sum()))
        self.lost, self.was_on_target = self.lost | newly, on_target
        return values


def moved(pose: mpm.Pose) -> mpm.Pose:
    return mpm.Pose(pose.position + [0.002, 0.001, 0.003], pose.quaternion)


def test_readings_agree_with_numpy_and_with_those_of_an_advance() -> None:
    """Ten readings, one after each of ten advances, and ten within one advance along the same way."""
    solver, tally, chosen = scene(ranks=True, reach=0.03)
    reference = Reference(solver, chosen)
    tally.restart()
    read, way = [], [solver.collider_pose(0)]
    for _ in range(10):
        way.append(moved(way[-1]))
        solver.set_collider_motion(0, *way[-2:])
        solver.advance(5e-3)
        read.append(tally.read())
        expected = reference.read()
        assert read[-1][:6] == pytest.approx(expected, rel=1e-9, abs=1e-12)
        x = solver.positions()
        ranks = read[-1].ranks
        assert ranks is not None
        assert ranks[:, 0] == pytest.approx(WEIGHTS @ np.abs(x[chosen] - GOAL).T, rel=1e-6)
        assert (ranks[:, 1] > 0).tolist() == TARGET.holds(x[chosen]).tolist()
        phi = solver.colliders[0].sdf.distance(solver.collider_pose(0).inverse().apply(x))
        assert read[-1].touching == (phi < 0.03).sum() > 0
    assert sum(r.newly_lost for r in read) == read[-1].lost > 5 and sum(r.lost_on_target for r in read) > 0
    places = solver.positions()

    solver, tally, chosen = scene(ranks=True, reach=0.03)
    sample = mpm.Sample(solver, chosen)
    solver.attach(tally, sample)
    tally.restart()
    solver.set_collider_motion(0, *way)
    for now, before in zip(solver.advance(5e-2, looks=10), read, strict=True):
        assert now[:-1] == before[:-1] and np.array_equal(now.ranks, before.ranks)  # pyright: ignore[reportArgumentType]
    assert np.array_equal(solver.positions(), places)
    assert sample.values[:, :3] == pytest.approx(places[chosen], abs=1e-6)
    assert sample.values[:, 3:] == pytest.approx(solver.velocities()[chosen], abs=1e-6)


def test_readings_of_a_step_that_is_taken_back_are_not_counted_twice() -> None:
    """A tool that contact moves: who was lost, and who was on target, returns with the grains."""
    solver, tally, _ = scene(mobile=True, ranks=True)
    solver.attach(tally)
    state = solver.state()
    state["v"] = state["v"] + [2.0, 0.0, -1.0]
    solver.load(state)
    tally.restart()
    solver.advance(0.02)
    for change in (lambda: None, tally.read):
        solver.keep()
        change()  # a look between is taken back, too
        first = solver.advance(0.02)[0]
        solver.rewind()
        again = solver.advance(0.02)[0]
        if change is not tally.read:
            assert first[:-1] == again[:-1] and first.newly_lost > 0
        solver.rewind()
        assert tally.read().lost < again.lost


def test_points_near_the_probe_are_counted() -> None:
    points = np.array([[0.2, 0.2, 0.055], [0.2, 0.2, 0.06], [0.26, 0.2, 0.03], [0.0, 0.0, 0.0]])
    solver, tally, _ = scene(points=points, probe=mpm.Sdf.box((0.04, 0.04, 0.02)), margin=0.0075)
    now = tally.read()
    phi = solver.colliders[0].sdf.distance(points - [0.2, 0.2, 0.03])
    assert now.probed == (phi < 0.0075).sum() == 1
    assert now.clearance == pytest.approx(phi.min(), abs=1e-6)


def test_looks_are_checked() -> None:
    solver, _, _ = scene()
    with pytest.raises(mpm.InvalidValue, match="looks = 0; accepted: 1 to 64"):
        solver.advance(1e-3, looks=0)

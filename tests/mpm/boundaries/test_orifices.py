"""Small holes in shells: they pass what Beverloo's law says, or nothing, and keep mass and momentum."""

from typing import Any

import numpy as np
import pytest
import trimesh
from field_parts import same, sand

import mpm

CELL, HALF, DEEP = 0.006, 0.018, 0.03
SPACING = CELL / 2
SALT = sand(E=1.5e5, density=1217.0, friction_angle_deg=33.0)
HOLE = {"diameter": 4e-3, "grain_diameter": 4e-4}
START = np.array([0.036, 0.036, 0.06])


def can() -> mpm.Shell:
    """A square can, its floor at z = 0, open on top."""
    box = trimesh.creation.box((2 * HALF, 2 * HALF, 2 * DEEP))
    open_box = trimesh.Trimesh(box.vertices, box.faces[box.triangles_center[:, 2] < DEEP - 1e-6])
    open_box.apply_translation((0, 0, DEEP))
    return mpm.Shell.from_mesh(open_box, 1.5e-3)


def turned(degrees: float, position: np.ndarray = START) -> mpm.Pose:
    """A pose, turned about the y axis."""
    half = np.radians(degrees) / 2
    return mpm.Pose(np.asarray(position, float), np.array([np.cos(half), 0.0, np.sin(half), 0.0]))


def filled(pose: mpm.Pose | None = None, hole: dict[str, float] | None = None, places: Any = ((0.0, 0.0, 0.0),),
           mobile: bool = False, **choices: Any) -> mpm.Solver:
    """The can half full of salt, with holes in its floor that let grains out downward."""
    pose = pose or turned(0.0)
    rng = np.random.default_rng(0)
    grains = mpm.sample_box((-HALF, -HALF, 0.0), (HALF, HALF, 0.5 * DEEP * 2), SPACING, rng)
    inside = (np.abs(grains[:, :2]) < HALF - 0.6 * SPACING).all(1) & (grains[:, 2] > 0.6 * SPACING)
    orifice = [mpm.Orifice(np.array(places), np.array([0.0, 0.0, -1.0]), **(hole or HOLE))] if len(places) else []
    collider = mpm.Collider(can(), friction=0.3, pose=pose, mobile=mobile, orifices=orifice)
    return mpm.Solver(**{"grid": mpm.Grid((0, 0, 0), (0.072, 0.072, 0.12), CELL), "colliders": [collider],
                         "bodies": [mpm.Body(SALT, pose.apply(grains[inside]), volume=SPACING**3)],
                         "walls": mpm.Walls(friction=0.5)} | choices)


def boxed(bottom: float, top: float) -> mpm.Solver:
    """The can with a lid, 0.06 m above its floor, and in line with the hole a column at rest from `bottom` to `top` [m]
    above the floor, as second body."""
    box = trimesh.creation.box((2 * HALF, 2 * HALF, 2 * DEEP))
    box.apply_translation((0, 0, DEEP))
    hole = mpm.Orifice(np.zeros((1, 3)), np.array([0.0, 0.0, -1.0]), diameter=8e-3, grain_diameter=4e-4)
    collider = mpm.Collider(mpm.Shell.from_mesh(box, 1.5e-3), friction=0.3, pose=turned(0.0), orifices=[hole])
    column = mpm.sample_box((-0.006, -0.006, bottom), (0.006, 0.006, top), SPACING, np.random.default_rng(1))
    with filled() as can_only:
        bed = can_only.positions()
    return filled(grid=mpm.Grid((0, 0, 0), (0.072, 0.072, 0.156), CELL), colliders=[collider],
                  bodies=[mpm.Body(SALT, places, volume=SPACING**3) for places in (bed, START + column)])


def law_of(solver: mpm.Solver) -> mpm.Orifice:
    return solver.colliders[0].orifices[0]


def shake(solver: mpm.Solver, duration: float, amplitude: float, frequency: float) -> None:
    """Move the can up and down [m], [Hz]."""
    dt = 2e-3
    for step in range(round(duration / dt)):
        ends = [START + [0, 0, amplitude * np.sin(2 * np.pi * frequency * dt * (step + k))] for k in (0, 1)]
        solver.set_collider_motion(0, *(turned(0.0, end) for end in ends))
        solver.advance(dt)


@pytest.mark.long
@pytest.mark.parametrize("ratio", [6.0, 20.0])
def test_holes_pass_what_the_law_says(ratio: float) -> None:
    """Two holes, half a second: each is within a particle of the law, the first within half of one; what has passed is
    below."""
    hole = {"diameter": 4e-3, "grain_diameter": 4e-3 / ratio}
    with filled(hole=hole, places=((-0.008, 0.0, 0.0), (0.008, 0.002, 0.0))) as solver:
        mass, rate = solver.masses()[0], law_of(solver).rate(SALT.density)
        assert rate == pytest.approx(0.58 * 1217 * np.sqrt(9.81) * (4e-3 - 1.4 * 4e-3 / ratio) ** 2.5)
        solver.advance(0.5)
        passed = solver.passed_mass(0)
        assert (np.abs(passed - rate * solver.time) <= mass * np.array([0.51, 1.01])).all()
        below = solver.positions()[:, 2] < START[2]
        assert below.sum() * mass == pytest.approx(passed.sum(), rel=1e-5)


@pytest.mark.long
def test_nothing_passes_below_the_blocked_ratio() -> None:
    with filled(hole={"diameter": 4e-3, "grain_diameter": 4e-3 / 3.9}) as solver:
        shake(solver, 0.2, 1e-3, 30.0)
        assert solver.passed_mass(0) == [0.0] and (solver.positions()[:, 2] > START[2]).all()


@pytest.mark.long
def test_a_hole_passes_outward_only() -> None:
    """Below a slanted floor the law's gravity is the component along the axis; above one nothing falls in."""
    with filled() as solver:
        solver.set_gravity(9.81 * np.array([np.sin(np.radians(40.0)), 0.0, -np.cos(np.radians(40.0))]))
        solver.advance(0.4)
        rate = law_of(solver).rate(SALT.density, 9.81 * np.cos(np.radians(40.0)))
        assert solver.passed_mass(0)[0] == pytest.approx(rate * solver.time, abs=0.51 * solver.masses()[0])
        before = solver.passed_mass(0)[0]
        solver.set_gravity(np.array([0.0, 0.0, 9.81]))
        solver.advance(0.1)
        assert solver.passed_mass(0)[0] == before


@pytest.mark.long
def test_grains_feel_the_acceleration_of_the_shell() -> None:
    """A can that is lifted with 0.5 g passes sqrt(1.5) of what it passes at rest; one that is pulled down with 1.5 g
    nothing, but for the 4 ms over which its acceleration is smoothed."""
    for factor, share in ((0.5, np.sqrt(1.5)), (-1.5, 0.0)):
        with filled(hole=HOLE | {"diameter": 6e-3}) as solver:
            dt, a = 1e-3, factor * 9.81
            for step in range(80):
                z = [0.5 * a * (dt * (step + k)) ** 2 for k in (0, 1)]
                solver.set_collider_motion(0, *(turned(0.0, START + [0, 0, rise]) for rise in z))
                solver.advance(dt)
            due = solver.state()["orifices"][0, 3] + solver.passed_mass(0)[0]
            at_rest = law_of(solver).rate(SALT.density)
            assert due == pytest.approx(share * at_rest * 0.08, abs=4e-3 * at_rest)


def test_a_hole_jams_after_an_avalanche_and_vibration_opens_it() -> None:
    hole = {"diameter": 6e-3, "grain_diameter": 2e-3, "blocked_ratio": 2.0}
    with filled(hole=hole) as solver:
        law, mass = law_of(solver), solver.masses()[0]
        avalanche = SALT.density * law.avalanche
        assert law.avalanche == pytest.approx(9900 / 1.94**6.9 * np.pi / 6 * 8e-9 / 0.6)
        solver.advance(1.5 * avalanche / law.rate(SALT.density))
        stopped = solver.passed_mass(0)[0]
        assert stopped == pytest.approx(avalanche, abs=0.6 * mass)
        solver.advance(0.2)
        assert solver.passed_mass(0)[0] == stopped
        shake(solver, 0.2, 1e-5, 30.0)  # 0.04 g
        assert solver.passed_mass(0)[0] == stopped
        shake(solver, 0.4, 0.5e-3, 30.0)  # 1.8 g
        assert solver.passed_mass(0)[0] - stopped > 0.5 * law.rate(SALT.density) * 0.4


@pytest.mark.long
def test_momentum_is_that_of_gravity_walls_and_shell() -> None:
    """Linear and angular, although particles are carried to another place; also where the can moves."""
    with filled(hole={"diameter": 8e-3, "grain_diameter": 4e-4}, precision="f64") as solver:
        before = np.concatenate(solver.momentum())
        given = np.zeros(6)
        for step in range(20):
            solver.set_collider_motion(0, turned(10.0 * step / 20), turned(10.0 * (step + 1) / 20))
            solver.advance(5e-3)
            given += solver.ledger.sum(0)
        assert solver.passed_mass(0)[0] > 5 * solver.masses()[0]
        assert np.concatenate(solver.momentum()) - before == pytest.approx(given, abs=1e-13)


@pytest.mark.long
def test_a_mobile_shell_receives_the_reaction() -> None:
    """A can of 50 g that falls from rest on nothing: it and the grains gain what gravity gives to the grains."""
    weight = 0.05
    with filled(hole={"diameter": 8e-3, "grain_diameter": 4e-4}, mobile=True, precision="f64") as solver:
        W = np.diag([1 / weight] * 3 + [1 / 2e-5] * 3)
        twist, centre = np.zeros(6), START.copy()
        solver.set_collider_mobility(0, W, twist, twist=twist, centre=centre)
        first = np.concatenate(solver.momentum())
        falling = np.zeros(6)
        for _ in range(20):
            solver.advance(1e-3)
            falling += solver.ledger[0]
            linear, angular = solver.collider_twist(0)
            centre = solver.collider_pose(0).position
            own = np.concatenate([weight * linear, 2e-5 * angular + np.cross(centre, weight * linear)])
            assert np.concatenate(solver.momentum()) + own - first == pytest.approx(falling, abs=1e-13)
            # held up as a scale would, so that it does not run away from the grains
            solver.set_collider_mobility(0, W, np.concatenate([linear, angular]), centre=centre)
        assert solver.passed_mass(0)[0] > 0


@pytest.mark.long
def test_the_wall_opposite_a_hole_does_not_recede() -> None:
    """A column that touches the lid from inside falls freely, while the hole below flows."""
    with boxed(0.0445, 0.058) as solver:
        column = solver.positions()[:, 2] > START[2] + 0.04
        solver.advance(2e-3)
        assert solver.state()["orifices"][0, 7] > 2 * 9.81 * solver.time  # faster than it falls
        assert solver.velocities()[column] == pytest.approx(np.tile([0.0, 0.0, -9.81 * solver.time],
                                                                    (column.sum(), 1)), abs=4e-3)


@pytest.mark.slow
def test_grains_on_the_wall_opposite_a_hole_do_not_block_it() -> None:
    with boxed(0.0615, 0.0705) as solver:
        column = solver.positions()[:, 2] > START[2] + 0.06
        solver.advance(0.2)
        assert (solver.positions()[column, 2] > START[2] + 0.06).all()
        assert solver.passed_mass(0)[0] == pytest.approx(law_of(solver).rate(SALT.density) * solver.time,
                                                         abs=0.51 * solver.masses()[0])


def test_a_jam_outlasts_a_grain_that_blocks_the_hole() -> None:
    hole = {"diameter": 6e-3, "grain_diameter": 2e-3, "blocked_ratio": 2.0}
    with filled(hole=hole) as solver:
        solver.advance(1.5 * SALT.density * law_of(solver).avalanche / law_of(solver).rate(SALT.density))
        solver.advance(0.1)
        state = solver.state()
        grain = int(np.argmin(solver.positions()[:, 2]))
        state["x"][grain] += START - [0.0, 0.0, 2.5e-3] - solver.positions()[grain]
        for name in ("v", "C", "e", "vc"):
            state[name][grain] = 0.0
        solver.load(state)
        solver.advance(0.2)
        assert solver.positions()[grain, 2] < START[2] - 0.02  # it has fallen
        assert np.array_equal(solver.state()["orifices"][0, [5, 6]], state["orifices"][0, [5, 6]])


def test_state_checkpoint_and_a_failed_advance_keep_what_is_due() -> None:
    with filled(hole=HOLE | {"diameter": 6e-3}) as solver:
        solver.advance(0.05)
        state = solver.state()
        assert state["orifices"].shape == (1, 8) and state["orifices"][0, 6] == solver.passed_mass(0)[0] > 0
        solver.store_checkpoint()
        solver.advance(0.05)
        end = solver.state()
        for restore in (lambda: solver.load(state), solver.restore_checkpoint):
            restore()
            solver.advance(0.05)
            assert same(solver.state(), end)
        bad = solver.state()
        bad["v"][0] = 1e6
        solver.load(bad)
        with pytest.raises(mpm.SimulationDiverged):
            solver.advance(0.05)
        assert np.array_equal(solver.state()["orifices"], bad["orifices"])
        with pytest.raises(mpm.InvalidValue, match="orifices"):
            solver.load({name: values for name, values in state.items() if name != "orifices"})


@pytest.mark.slow
def test_a_batch_passes_what_a_solver_passes() -> None:
    with filled(hole=HOLE | {"diameter": 6e-3}) as solver:
        start = solver.state()
        solver.advance(0.02)
        middle = solver.state()
        batch = mpm.Batch(solver, 2)
        batch.load(0, start)
        batch.load(1, middle)
        for _ in range(2):
            batch.advance(np.full(2, 0.02), np.ones(2, int))
        solver.load(middle)
        for _ in range(2):
            solver.advance(0.02)
        alone = solver.state()
        batch.select(1)
        assert all(np.array_equal(solver.state()[name], alone[name]) for name in ("x", "orifices"))
        batch.select(0)
        assert 0 < solver.passed_mass(0)[0] < alone["orifices"][0, 6]


@pytest.mark.slow
def test_a_slow_hole_flows_on_although_grains_may_sleep() -> None:
    """One particle in 0.15 s: in between the bed is calm."""
    with filled(hole={"diameter": 2e-3, "grain_diameter": 3e-4}, sleep=True) as solver:
        solver.advance(1.5)
        law, mass = law_of(solver).rate(SALT.density) * 1.5, solver.masses()[0]
        assert law > 5 * mass and solver.passed_mass(0)[0] == pytest.approx(law, abs=0.51 * mass)


def test_what_is_refused() -> None:
    down = np.array([0.0, 0.0, -1.0])
    one = np.zeros((1, 3))
    for places, axes, numbers, message in (
            (one, down, {"diameter": 0.0}, "diameter = 0"), (one, down, {"k": -1.0}, "k = -1"),
            (one, down, {"grain_diameter": np.inf}, "grain_diameter = inf"), (one, down, {"C": 0.0}, "C = 0"),
            (one, down, {"vibration": np.nan}, "vibration = nan"), (one, 0 * down, {}, r"axes\[0\] has no length"),
            (np.zeros((2, 2)), down, {}, "shape")):
        with pytest.raises(mpm.InvalidValue, match=message):
            mpm.Orifice(places, axes, **(HOLE | numbers))
    for shape, place, axis, message in (
            (mpm.Sdf.sphere(0.01), one, down, r"orifices in a .*accepted: in a mpm.Shell"),
            (can(), one + [0, 0, 0.005], down, "hole 0 at .* 0.005 m from the shell's mid-surface"),
            (can(), one, np.array([1.0, 0.0, 0.0]), "90 deg off the normal")):
        with pytest.raises(mpm.InvalidValue, match=message):
            mpm.Collider(shape, orifices=[mpm.Orifice(place, axis, **HOLE)])
    water = mpm.Body(mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0), START[None] + [0, 0, 0.01], volume=1e-8)
    with pytest.raises(mpm.InvalidValue, match=r"bodies\[0\] is a fluid"):
        filled(bodies=[water])
    with filled() as solver, pytest.raises(mpm.InvalidValue, match="an orifice, which is not differentiated"):
        mpm.Rollout(solver, 2)
    with filled(places=()) as solver, pytest.raises(mpm.InvalidValue, match="collider 0 has no orifices"):
        solver.passed_mass(0)

"""Rollouts against central differences in double precision, over twenty random directions each."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from end_loss import LAWS, STRIDE, along_directions, cosine_of, weighted_ends
from field_parts import at, block
from scipy.spatial.transform import Rotation

import mpm
from mpm.backend import once, ti
from mpm.geometry.rigid_motion import rotate
from mpm.materials.symmetric_tensor import compose, spectrum
from mpm.rollout.losses import LossGradient, RolloutStates
from mpm.rollout.schedule import plan_schedule
from mpm.stepping.snapshots import StateBank

CELL, STEPS, SUBSTEPS = 0.01, 100, 5


def scene(*laws, precision: str = "f64", interval: float = STRIDE, **options) -> mpm.Solver:
    """A block on the floor beside a wall, a lattice tool that comes at it, and a static ball. Nodes of the field lie
    beside those of the tool's lattice: on them its normals jump at the least step."""
    bodies = [block(law, (0.04, 0.03 * i, 0.0), (0.07, 0.03 + 0.03 * i, 0.03), CELL / 2, rng=np.random.default_rng(i))
              for i, law in enumerate(laws)]
    tool = mpm.Collider(mpm.Sdf.from_mesh(trimesh.creation.box((0.02, 0.06, 0.04)), spacing=2.5e-3), friction=0.3,
                        pose=at(0.0261, 0.0203, 0.0357))
    ball = mpm.Collider(mpm.Sdf.sphere(0.02), friction=0.2, static=True, pose=at(0.09, 0.02, 0.0))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.14, 0.1, 0.08), CELL), bodies=bodies, colliders=[tool, ball],
                        walls=mpm.Walls(friction=0.4), precision=precision, transfer_interval=interval, **options)
    solver.advance(0.02)
    return solver


def motion(steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    return np.tile([0.25, 0.02, -0.02], (steps, 1)), np.tile([0.3, 0.8, 0.5], (steps, 1))


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_gradient_by_the_tools_motion(name):
    """50 and 500 substeps with contact: cosine with differences at least 0.9999.
    Single grains of sand that fly at the tool share light nodes with others, and multiply a change of 1e-11 to 1e-5 in
    three steps: most differences over 50 substeps say nothing. Those are compared that are the same at two steps; over
    500 substeps only the derivatives are asked for."""
    solver = scene(LAWS[name])
    roll = mpm.Rollout(solver, STEPS, step_dt=SUBSTEPS * solver.dt)
    assert roll.substeps == SUBSTEPS
    linear, angular = motion()
    for last in (10, STEPS):
        loss = weighted_ends(len(solver.masses()), last)
        value, found = roll.value_and_grad(linear, angular, loss)
        assert value == roll.value(linear, angular, loss) and np.all(found[0][last:] == 0.0)
        assert np.abs(found[0][:last]).max() > 0.0
        if name == "sand" and last == STEPS:
            assert np.isfinite(found[0]).all()
            continue
        gradient, difference = along_directions(roll, linear, angular, loss, found, 20)
        if name == "sand":
            other = along_directions(roll, linear, angular, loss, found, 20, 3e-7)[1]
            is_smooth = np.abs(difference - other) < 1e-3 * np.linalg.norm(gradient)
            assert is_smooth.sum() >= 3
            gradient, difference = gradient[is_smooth], difference[is_smooth]
        assert cosine_of(gradient, difference) > 0.9999, last
        assert np.linalg.norm(gradient) == pytest.approx(np.linalg.norm(difference), rel=1e-2)


@pytest.fixture(scope="module")
def settled_pair() -> tuple[mpm.Solver, dict]:
    solver = scene(LAWS["fluid"], LAWS["sand"])
    return solver, solver.state()


@pytest.fixture
def two_materials(settled_pair) -> mpm.Solver:
    """Always from the same state: a rollout leaves its solver at the end."""
    solver, start = settled_pair
    solver.load(start)
    return solver


@pytest.fixture(scope="module")
def pair_roll(settled_pair) -> mpm.Rollout:
    """Twenty steps of the two materials, compiled once."""
    solver, start = settled_pair
    solver.load(start)
    return mpm.Rollout(solver, 20, step_dt=SUBSTEPS * solver.dt, materials=True)


@pytest.fixture(scope="module")
def fluid_roll() -> mpm.Rollout:
    """Twenty steps of a fluid, whose kernels take a third of the time to compile."""
    solver = scene(LAWS["fluid"])
    return mpm.Rollout(solver, 20, step_dt=SUBSTEPS * solver.dt)


@pytest.mark.slow
def test_the_roll_out_is_the_solvers_own_future(two_materials, pair_roll):
    """The same numbers to rounding as `advance`, with two materials."""
    solver, roll = two_materials, pair_roll
    start = solver.state()
    linear, angular = motion(20)
    roll.value(linear, angular, weighted_ends(len(solver.masses()), 20))
    rolled = solver.state()
    solver.load(start)
    for k in range(20):
        begin = solver.collider_pose(0)
        solver.set_collider_motion(0, begin, roll._path.pose(k + 1))
        solver.advance(SUBSTEPS * solver.dt)
    advanced = solver.state()
    for name in ("x", "v", "C", "e", "j", "vc"):
        scale = np.abs(advanced[name]).max()
        assert np.abs(rolled[name] - advanced[name]).max() <= 1e-9 * scale, name
    assert rolled["poses"] == pytest.approx(advanced["poses"], abs=1e-12)
    assert float(rolled["time"]) == pytest.approx(float(advanced["time"]))
    solver.load(start)


@pytest.mark.slow
def test_gradient_through_uneven_strides():
    """Steps of two, two and one substeps."""
    solver = scene(LAWS["elastic"])
    solver = scene(LAWS["elastic"], interval=2.0 * solver.dt)
    roll = mpm.Rollout(solver, 10, step_dt=SUBSTEPS * solver.dt)
    linear, angular = motion(10)
    loss = weighted_ends(len(solver.masses()), 10)
    _, found = roll.value_and_grad(linear, angular, loss)
    assert np.unique(roll._kernel.begin.to_numpy()[:11]).tolist() == [0, 2, 4, 5, 7, 9, 10]
    gradient, difference = along_directions(roll, linear, angular, loss, found, 5)
    assert gradient == pytest.approx(difference, rel=1e-3)


@pytest.mark.slow
def test_a_smaller_budget_changes_no_bit(two_materials):
    """Every number of levels gives the same gradient, and runs no step more often than it says."""
    solver = two_materials
    linear, angular = motion(20)
    loss = weighted_ends(len(solver.masses()), 20)
    start, size = solver.state(), StateBank.bytes_per_state(solver.particles.state_fields, "f64")
    found = []
    for states in (200, 40, 20):
        solver.load(start)
        roll = mpm.Rollout(solver, 20, step_dt=SUBSTEPS * solver.dt, budget=states * size)
        found.append((roll.schedule.levels, roll.value_and_grad(linear, angular, loss)))
        assert roll.schedule.n_bytes <= states * size and roll.forward_steps <= 20 * (1 + roll.schedule.levels)
        assert roll.value(linear, angular, loss) == pytest.approx(found[-1][1][0], rel=1e-12)
    assert [levels for levels, _ in found] == sorted({levels for levels, _ in found})
    for _, (_, gradient) in found[1:]:
        assert np.array_equal(gradient, found[0][1][1])


@pytest.mark.slow
def test_grains_wait_for_a_wall_in_a_rollout_as_in_the_solver(fluid_roll):
    """Thrown down at the floor: positions of a rollout and of the solver, and slopes along three directions."""
    solver, before, loss = fluid_roll.solver, fluid_roll.start, weighted_ends(len(fluid_roll.start["x"]), 20)
    start = before | {"v": before["v"] + [0.0, 0.0, -2.0]}
    solver.load(start)
    fluid_roll.restart()
    fluid_roll.value(*np.zeros((2, 20, 3)), loss)
    rolled, (_, found) = solver.state()["x"], fluid_roll.value_and_grad(*motion(20), loss)
    gradient, difference = along_directions(fluid_roll, *motion(20), loss, found, 3)
    solver.load(start)
    for _ in range(20):
        solver.advance(SUBSTEPS * solver.dt)
    played = solver.state()["x"]
    solver.load(before)
    fluid_roll.restart()
    assert rolled == pytest.approx(played, abs=1e-12)
    assert gradient == pytest.approx(difference, rel=1e-3)


def test_schedules():
    """Steps are covered, memory is what was asked for, and what cannot be done says the least that can."""
    for steps, substeps, states in ((1000, 10, 300), (1000, 10, 60), (7, 3, 12), (1, 1, 3), (999, 1, 25)):
        plan = plan_schedule(steps, substeps, 100, 100 * states)
        assert plan.chunk * plan.parts**plan.levels >= steps and plan.slots + plan.checkpoints <= states
    with pytest.raises(mpm.InvalidValue, match="accepted: [0-9]+ bytes or more") as error:
        plan_schedule(1000, 10, 100, 1000)
    least = int(str(error.value).split("accepted: ")[1].split()[0])
    assert plan_schedule(1000, 10, 100, least).n_bytes == least
    with pytest.raises(mpm.InvalidValue):
        plan_schedule(1000, 10, 100, least - 1)


@pytest.mark.slow
def test_gradient_by_start_and_materials(two_materials, pair_roll):
    """Of the tool's initial pose and of each law's numbers."""
    solver, roll = two_materials, pair_roll
    start = solver.state()
    linear, angular = motion(20)
    loss = weighted_ends(len(solver.masses()), 20)
    roll.value_and_grad(linear, angular, loss)
    found = roll.last
    for axis in range(6):
        ends = []
        for sign in (1e-8, -1e-8):
            moved = dict(start)
            pose = start["poses"][0].copy()
            if axis < 3:
                pose[axis] += sign
            else:
                pose[3:] = rotate(pose[3:], sign * np.eye(3)[axis - 3])
            moved["poses"] = np.array([pose, start["poses"][1]])
            solver.load(moved)
            roll.restart()
            ends.append(roll.value(linear, angular, loss))
        bar = np.concatenate([found.twists.start_position, found.twists.start_turn])
        assert bar[axis] == pytest.approx((ends[0] - ends[1]) / 2e-8, rel=1e-4, abs=1e-4 * np.abs(bar).max()), axis
    solver.load(start)
    roll.restart()
    laws = [body.material for body in solver.bodies]
    for index, name in ((0, "bulk_modulus"), (0, "viscosity"), (1, "E"), (1, "nu"), (1, "friction_angle_deg")):
        value = getattr(laws[index], name)
        ends = []
        for sign in (1e-7, -1e-7):
            solver.set_material(index, replace(laws[index], **{name: value * (1 + sign)}))
            ends.append(roll.value(linear, angular, loss))
        solver.set_material(index, laws[index])
        assert found.materials[index][name] * value == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-3), name
    solver.load(start)


def test_what_is_not_finite_is_named(fluid_roll):
    """Never zeroed: the step and the particle."""

    def broken(states: RolloutStates) -> LossGradient:
        bar = np.zeros(states.x.shape)
        bar[states.steps == 7, 11] = np.nan
        return LossGradient(0.0, x=bar)

    with pytest.raises(mpm.GradientDiverged, match="particle") as error:
        fluid_roll.value_and_grad(*motion(20), broken)
    assert (error.value.step, error.value.particle) == (6, 11)


def test_what_grows_beyond_all_numbers_is_found(fluid_roll):
    """A derivative that overflows on the way back, not in the loss; the solver is left at the start and goes on."""
    solver = fluid_roll.solver
    n = len(solver.masses())

    def huge(states: RolloutStates) -> LossGradient:
        bar = np.zeros(states.x.shape)
        bar[states.steps == 9] = 1e308
        return LossGradient(0.0, x=bar)

    with pytest.raises(mpm.GradientDiverged) as error:
        fluid_roll.value_and_grad(*motion(20), huge)
    assert error.value.step <= 8 and solver.positions() == pytest.approx(fluid_roll.start["x"] + solver.grid.origin)
    assert float(solver.time) == float(fluid_roll.start["time"])
    solver.advance(solver.dt)
    assert np.isfinite(solver.positions()).all() and fluid_roll.value(*motion(20), weighted_ends(n, 20)) != 0.0
    assert error.value.substep == 0  # where the stride begins, the whole step


@pytest.mark.slow
def test_options_against_growth(two_materials):
    """A limit that nothing reaches and a window as long as the rollout change no bit; a short window only what is
    farther back."""
    solver = two_materials
    loss = weighted_ends(len(solver.masses()), 20)
    start = solver.state()

    def rolled(**options) -> tuple[np.ndarray, np.ndarray]:
        solver.load(start)
        roll = mpm.Rollout(solver, 20, step_dt=SUBSTEPS * solver.dt, **options)
        return roll.value_and_grad(*motion(20), loss)[1][0], roll.last.norms

    free = rolled()[0]
    assert np.array_equal(rolled(limit=1e30)[0], free) and np.array_equal(rolled(window=20)[0], free)
    short, norms = rolled(window=5)
    assert np.array_equal(short[15:], free[15:]) and np.all(norms[:15] == 0.0)
    assert np.all(norms[15:] > 0.0)
    cut = rolled(limit=0.01 * np.abs(free).max())[0]
    assert np.isfinite(cut).all() and not np.array_equal(cut, free)


@pytest.mark.parametrize("options, message", [
    ({"n_steps": 0}, "n_steps = 0"), ({"window": 0}, "window = 0"), ({"limit": -1.0}, "limit = -1"),
    ({"budget": 10}, "bytes or more"), ({"substeps": 1}, "substeps of a step"), ({"n_steps": 2.5}, "whole number"),
    ({"substeps": -1}, "substeps = -1"), ({"step_dt": 0.0}, "step_dt = 0"),
])
def test_what_cannot_be_rolled_out(fluid_roll, options, message):
    with pytest.raises(mpm.InvalidValue, match=message):
        mpm.Rollout(fluid_roll.solver, **{"n_steps": 20, **options})


def test_scenes_without_adjoint():
    body = mpm.Body(LAWS["sand"], np.full((4, 3), 0.5) + 0.01 * np.arange(4)[:, None], volume=1e-6)
    grid = mpm.Grid((0, 0, 0), (1, 1, 1), 0.1)
    with pytest.raises(mpm.InvalidValue, match="periodic"):
        mpm.Rollout(mpm.Solver(grid=grid, bodies=[body], walls=mpm.Walls.all("periodic")), 1)
    mobile = mpm.Collider(mpm.Sdf.sphere(0.1), mobile=True)
    with pytest.raises(mpm.InvalidValue, match="mobile"):
        mpm.Rollout(mpm.Solver(grid=grid, bodies=[body], colliders=[mobile]), 1)


def test_eigenvalues_that_coincide():
    """In single precision, where the squares of what Jacobi's rotations leave fall below the smallest number."""
    rng = np.random.default_rng(0)
    d = 1e-4 * rng.uniform(-1.0, 1.0, (3000, 3))
    d[:1000, 1] = d[:1000, 0]
    d[1000:1100] = d[1000:1100, :1]
    R = Rotation.random(3000, random_state=1).as_matrix()
    full = np.einsum("nij,nj,nkj->nik", R, d, R)
    given = np.ascontiguousarray(full[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], np.float32)
    found = np.zeros((3000, 9), np.float32)

    @ti.kernel
    def run(a: ti.types.ndarray(), out: ti.types.ndarray()):
        for k in range(a.shape[0]):
            values, vectors = spectrum([once(a[k, i]) for i in range(6)], 4)
            back = compose(values, vectors)
            for i in ti.static(range(3)):
                out[k, i] = values[i]
            for i in ti.static(range(6)):
                out[k, 3 + i] = back[i]

    run(given.copy(), found)
    assert np.sort(found[:, :3], 1) == pytest.approx(np.sort(d, 1), abs=1e-10)
    assert found[:, 3:] == pytest.approx(given, abs=1e-10)

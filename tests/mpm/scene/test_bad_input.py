"""What is refused, and what is only suspicious: each names the value and the remedy."""

import numpy as np
import pytest
import trimesh
from field_parts import UPRIGHT, at, block, same, sand

import mpm


def solver(bodies: list[mpm.Body], colliders: list[mpm.Collider] | None = None, cell: float = 0.01,
           **more) -> mpm.Solver:
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), cell), bodies=bodies, colliders=colliders, **more)


def cube(lower: float = 0.05, upper: float = 0.1, **material) -> mpm.Body:
    return block(sand(**material), (lower,) * 3, (upper,) * 3, 0.005)


@pytest.mark.parametrize(("wrong", "message"), [
    ({"density": -1.0}, "density"), ({"friction_angle_deg": 90.0}, "friction_angle_deg = 90"),
    ({"friction_angle_deg": -1.0}, "friction_angle_deg"), ({"E": 0.0}, "E"), ({"nu": 0.5}, "nu")])
def test_materials_refuse(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(mpm.InvalidValue, match=message):
        sand(**wrong)


@pytest.mark.parametrize("interval", [-1e-3, float("nan"), "long"])
def test_a_stride_lasts_some_time(interval: float | str) -> None:
    with pytest.raises(mpm.InvalidValue, match=f"transfer_interval = {interval!r}"):
        solver([cube()], transfer_interval=interval)


def test_bodies_are_neither_empty_nor_outside() -> None:
    with pytest.raises(mpm.InvalidValue, match="shape"):
        mpm.Body(sand(), np.zeros((0, 3)), volume=1e-6)
    with pytest.raises(mpm.InvalidValue, match="outside the grid"):
        solver([cube(0.15, 0.25)])


@pytest.mark.parametrize(("bodies", "kind", "message"), [
    ([cube(0.05, 0.1), cube(0.08, 0.13)], mpm.OverlappingBodies, "of body 1 lie within half a grain of one of body 0"),
    ([cube(0.01, 0.19, E=1e3)], mpm.StrongCompression, "times its E")], ids=["overlap", "too soft for its weight"])
def test_suspicious_bodies_are_reported(bodies: list[mpm.Body], kind: type[Warning], message: str) -> None:
    with pytest.warns(kind, match=message):
        solver(bodies)


def test_open_mesh_for_a_solid_offers_the_shell() -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]])
    with pytest.raises(mpm.InvalidValue, match="open edges.*Shell.from_mesh"):
        mpm.Sdf.from_mesh(sheet)
    with pytest.raises(mpm.InvalidValue, match="thickness = 0"):
        mpm.Shell.from_mesh(sheet, 0.0)
    twisted = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 2, 3]])
    with pytest.raises(mpm.InvalidValue, match="opposite ways"):
        mpm.Shell.from_mesh(twisted, 1e-3)


def test_a_narrow_neck_is_reported() -> None:
    profile = np.array([[0.0, 0.0], [0.03, 0.0], [0.03, 0.05], [0.008, 0.07], [0.008, 0.09]])
    bottle = mpm.Shell.from_mesh(trimesh.creation.revolve(profile), 1e-3, spacing=3e-3)
    assert bottle.passage == pytest.approx(0.015, rel=0.03)  # the faces of a 32-sided neck, less the thickness
    with pytest.warns(mpm.NarrowPassage, match="it will jam; give cells of at most 3.7 mm"):
        solver([cube(0.09, 0.11)], [mpm.Collider(bottle, pose=at(0.1, 0.1, 0.05))], cell=0.005)


def test_walls_refuse() -> None:
    with pytest.raises(mpm.InvalidValue, match="both sides are periodic or none"):
        mpm.Walls(lower=("periodic", "slip", "slip"), upper=("slip", "slip", "slip"))
    slab = block(sand(), (0, 0, 0), (0.1, 0.01, 0.1), 0.005)
    with pytest.raises(mpm.InvalidValue, match="one cell along y between walls"):
        mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.1, 0.01, 0.1), 0.01), bodies=[slab])


def test_diagnostics_of_a_resting_cube() -> None:
    seen = solver([cube()], gravity=(0, 0, 0)).diagnostics()
    assert seen.mass == pytest.approx(0.1875) and seen.cfl == 0 and seen.escaped == 0
    on_floor = mpm.Body(sand(), np.array([[0.05, 0.05, 0.0], [0.05, 0.05, 0.05]]), volume=1e-7)
    assert solver([on_floor], gravity=(0, 0, 0)).diagnostics().escaped == 1
    assert seen.compaction == pytest.approx(0, abs=1e-12) and seen.first_non_finite is None


SAMPLED = {"point": np.zeros(3), "weights": np.ones(3), "index": 0, "region": mpm.Region((0, 0, 0), (1, 1, 1)),
           "inner": mpm.Region((0, 0, 0), (1, 1, 1)), "bounds": mpm.Region((0, 0, 0), (1, 1, 1))}


def ball(place: float = 0.132) -> mpm.Collider:
    return mpm.Collider(mpm.Sdf.sphere(0.03), pose=at(0.075, 0.075, place))


def test_numbers_that_are_none_are_refused() -> None:
    field, nan = solver([cube()], [ball()]), float("nan")
    with pytest.raises(mpm.InvalidValue, match="collider 0: .* accepted: finite"):
        field.set_collider_motion(0, field.collider_pose(0), at(nan, 0, 0))
    for duration in (nan, np.inf, 0.0, "a", None):
        with pytest.raises(mpm.InvalidValue, match="accepted: a positive time"):
            field.advance(duration)
    for duration in (1e9, 1e308):
        with pytest.raises(mpm.InvalidValue, match="substeps of .* s; accepted: up to 14913080 in one call"):
            field.advance(duration)
    with pytest.raises(mpm.InvalidValue, match="cell = nan"):
        mpm.Grid((0, 0, 0), (1, 1, 1), nan)
    with pytest.raises(mpm.InvalidValue, match="friction = nan"):
        mpm.Collider(mpm.Sdf.sphere(0.03), friction=nan)
    for gravity in ((0.0, 0.0), (0.0, 0.0, nan)):
        with pytest.raises(mpm.InvalidValue, match="gravity"):
            solver([cube()], gravity=gravity)
    for index in (-1, 1):
        for read in (field.collider_pose, field.collider_impulse, lambda i: field.collider_impulse(i, np.zeros(3))):
            with pytest.raises(mpm.InvalidValue, match=f"collider {index}; accepted: 0 to 0"):
                read(index)
    with pytest.raises(mpm.InvalidValue, match="collider 0 is not mobile"):
        field.collider_twist(0)


def test_what_no_substep_can_follow_is_refused_before_anything_moves() -> None:
    field = solver([cube()], [ball()])
    here, before = field.collider_pose(0), field.positions()
    field.set_collider_motion(0, here, mpm.Pose(here.position + [1e6, 0, 0], UPRIGHT))
    with pytest.raises(mpm.ColliderTooFast, match=r"collider 0 moves at 5e\+08 m/s; accepted: up to") as caught:
        field.advance(2e-3)
    assert field.time == 0 and (field.positions() == before).all() and field.collider_pose(0) is here
    end = mpm.Pose(here.position + [0, 0, 0.9 * 2e-3 * caught.value.accepted], UPRIGHT)
    field.set_collider_motion(0, here, end)
    assert field.paths.plan(2e-3, 1, field.dt, np.float32)[0] > 1000


@pytest.mark.long
def test_a_plane_reaches_no_farther_than_the_grid() -> None:
    """Turning, it needs the substeps of a plate of the grid's size: here 0.1 rad/s on 0.35 m, far below the bound."""
    floor = mpm.Collider(mpm.Sdf.plane(), pose=at(0.1, 0.1, 0.02))
    field = solver([cube()], [floor])
    half = 0.5 * 0.1 * 2e-3
    turned = mpm.Pose(floor.pose.position, np.array([np.cos(half), 0, np.sin(half), 0]))
    field.set_collider_motion(0, floor.pose, turned)
    field.advance(2e-3)
    assert field.steps == np.ceil(2e-3 / field.dt)


def test_a_state_of_another_scene_changes_nothing() -> None:
    field, other = solver([cube()], [ball()]), solver([cube()])
    field.advance(2e-3)
    before, foreign = field.state(), other.state()
    for state, words in ((foreign, r"poses has shape \(0, 7\); the scene has \(1, 7\)"),
                         ({k: v for k, v in before.items() if k != "time"}, "also needs time"),
                         ({**before, "v": before["v"] + 0.1j}, "v is of type complex.*; accepted: real numbers"),
                         ({**before, "twists": np.zeros((1, 6))}, "twists has shape")):
        with pytest.raises(mpm.InvalidValue, match=words):
            field.load(state)
        assert same(field.state(), before)


def test_a_state_with_grains_outside_the_grid_or_without_a_number_is_refused() -> None:
    """They would be written to nodes that do not exist; a grain on the plane of a wall is inside."""
    field = solver([cube()], [ball()])
    before = field.state()
    for name, value, words in (("x", -0.001, "load: 1 particles lie outside the grid"), ("x", 0.3, "particle 7 at"),
                               ("x", np.nan, "x of 1 particles is not finite"), ("v", np.inf, "particle 7 with")):
        state = {key: values.copy() for key, values in before.items()}
        state[name][7, 1] = value - field.grid.origin[1]
        with pytest.raises(mpm.InvalidValue, match=words):
            field.load(state)
        assert (field.state()[name] == before[name]).all()
    before["x"][7, 1] = np.float32(-field.grid.origin[1])
    field.load(before)


def test_a_counter_of_the_fields_before_is_refused() -> None:
    field = solver([cube()], [ball()])
    counter = mpm.RegionCounter(field, np.arange(5), **SAMPLED)
    field.set_colliders([ball()])
    with pytest.raises(mpm.InvalidValue, match="of other colliders"):
        field.attach(counter)


def test_a_collider_that_is_lost_is_named() -> None:
    """Its grains are well: the message does not blame one of them alone."""
    field = solver([cube()], [mpm.Collider(mpm.Sdf.sphere(0.03), mobile=True, pose=ball().pose)])
    field.set_collider_mobility(0, np.zeros((6, 6)), np.zeros(6))
    field.mobility.twists[0, 0] = np.nan
    with pytest.raises(mpm.SimulationDiverged, match="the motion of collider 0 is not finite") as caught:
        field.advance(2e-3)
    assert caught.value.collider == 0


def test_a_mobile_collider_needs_a_mobility() -> None:
    """Without one it would stand still, which is what a mobility of zero is for; after an error nothing has changed."""
    field = solver([cube()], [mpm.Collider(mpm.Sdf.sphere(0.03), mobile=True, pose=ball().pose)])
    for _ in range(2):
        with pytest.raises(mpm.InvalidValue, match=r"collider 0 is mobile and has no mobility; .* W = np.zeros"):
            field.advance(2e-3)
    field.set_collider_mobility(0, np.zeros((6, 6)), np.zeros(6))
    field.advance(2e-3)
    assert (field.collider_pose(0).position == ball().pose.position).all()


def test_a_motion_that_begins_elsewhere_is_reported() -> None:
    """Once a collider; not within the travel of a substep, and not where it is meant."""
    field = solver([cube()], [ball()])
    here = field.collider_pose(0)
    there = mpm.Pose(here.position + [0.02, 0, 0], UPRIGHT)
    turned = mpm.Pose(here.position, np.array([np.cos(0.2), 0, np.sin(0.2), 0]))
    for begin in (here, mpm.Pose(here.position + [0.002, 0, 0], -UPRIGHT)):
        field.set_collider_motion(0, begin, there)
    field.set_collider_motion(0, there, there, jump=True)
    with pytest.warns(mpm.ColliderJumped, match="collider 0 begins at .* 2 cells away; .* or give jump=True") as caught:
        field.set_collider_motion(0, there, here)
    assert len(caught) == 1 and caught[0].filename == __file__
    field.set_collider_motion(0, there, here)
    with pytest.warns(mpm.ColliderJumped, match="1.2 cells away"):
        solver([cube()], [ball()]).set_collider_motion(0, turned, here)

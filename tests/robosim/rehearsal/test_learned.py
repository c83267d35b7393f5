"""Learnt motions as paths of an arm: where they go, how they are slowed down, what is handed to a real arm."""

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import mpm
from robosim.config.materials import law_of, load_material
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.errors import ConfigError
from robosim.rehearsal import learned
from robosim.rehearsal.keep_clear import CLEAR, ENOUGH
from robosim.rehearsal.learned_path import REST, LearnedPath
from robosim.rehearsal.metrics import fates
from robosim.rehearsal.pose_sequences import JOINING, ROUNDING, SAMPLING
from robosim.rehearsal.rehearsal import plan
from robosim.robot.ros_trajectory import make_joint_trajectory
from robosim.robot.timing import compute_time_scale
from robosim.scene.container_clearance import build_real_tool_sdf
from robosim.scene.field import build_tool_sdf, check_field
from robosim.scene.fill import fill
from robosim.scene.frames import container_pose
from robosim.scene.models import read_inner_size
from robosim.shapes import tool_shape
from robosim.shapes.container import make_container_shell
from robosim.tasks.task import load_task


def motions(folder: Path, *names: str) -> None:
    """Motions that go 2 cm a second along y and turn by 10 deg a second about x, as files of learnt ones."""
    for name in names:
        action = load_task(name).action
        row = np.array([0.0, 0.02 / action.speed, 0.0, np.radians(10.0) / action.angular_speed, 0.0, 0.0])
        np.savez(folder / f"{name}.npz", actions=np.tile(row[: action.dimensions], (100, 1)), action_repeat=10)


@pytest.fixture
def chained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The rehearsal of the spoon with three plain motions."""
    motions(tmp_path, "SpoonScoop", "SpoonTranslate", "SpoonPour")
    monkeypatch.setattr(learned, "trained", lambda name: tmp_path / f"{name}.npz")
    return learned.placed(load_rehearsal("spoon", {"trajectory": "learned"}))


def test_a_motion_begins_where_the_last_has_ended(chained):
    """In the plane: 4 cm each along y from the place over the container on; at its own height and attitude; the target
    stands where the last one pours."""
    tasks = [load_task(name) for name in chained.learned]
    path = LearnedPath(chained)
    offset = np.array(chained.containers["source"].position) - tasks[0].container_place.position
    begin = np.array(tasks[0].start.position) + offset
    for k, task in enumerate(tasks):
        pose = path.pose(path.times[chained.learned[k]])
        assert pose.position[:2] == pytest.approx(begin[:2] + [0.0, 0.04 * k], abs=2e-3)
        assert pose.position[2] == pytest.approx(task.start.position[2] + offset[2] * (k == 0), abs=2e-3)
        turned = Rotation.from_matrix(pose.matrix.T @ task.start.pose.matrix).magnitude()
        assert turned < np.radians(2.0)
    place = np.array(tasks[2].target.centre[:2]) + (begin[:2] + [0.0, 0.08] - tasks[2].start.position[:2])
    assert chained.containers["target"].position[:2] == pytest.approx(place, abs=1e-9)
    assert chained.containers["source"] == load_rehearsal("spoon").containers["source"]
    begin, end = path.rests[chained.weigh_at]
    assert path.times["SpoonScoop"] + 2.0 < begin < end < path.times["SpoonTranslate"]
    assert path.pose(begin).position == pytest.approx(path.pose(end).position, abs=1e-9)
    assert end - begin == pytest.approx(REST)


def test_a_path_has_no_jumps(chained):
    """Speeds change by 2 v / ROUNDING per second at most, where a motion jumps from v to -v; rounding cuts little."""
    path = LearnedPath(chained)
    times = np.arange(0.0, path.duration, 0.01)
    places = np.array([path.pose(t).position for t in times])
    speed = np.diff(places, axis=0) / 0.01
    assert np.abs(np.diff(speed, axis=0)).max() / 0.01 < 2.0 * JOINING / ROUNDING
    assert path.rounded_by < 0.25 * JOINING * ROUNDING
    tip = np.array([0.03, 0.0, 0.0])
    for t in (0.5, 0.5 * path.duration):
        pose = path.pose(t)
        both = np.concatenate([pose.position, pose.apply(tip[None])[0]])
        assert np.abs(path.near(t, tip) - both).max(1).min() < 1e-3


def test_slowing_down_keeps_the_way(chained):
    """Twice as long at all times: the same places at twice the time, but for what rounding cuts."""
    path, slow = LearnedPath(chained), LearnedPath(chained)
    times = np.linspace(0.0, path.duration, 200)
    slow.slow_down(times, np.full(200, 2.0))
    assert slow.duration == pytest.approx(2.0 * path.duration, rel=1e-3)
    assert slow.slower_by == pytest.approx(2.0, rel=1e-2)
    for t in times[::20]:
        assert slow.pose(2.0 * t).position == pytest.approx(path.pose(t).position, abs=2.0 * path.rounded_by + 1e-6)
    assert slow.rounded_by < 0.7 * path.rounded_by
    faster = LearnedPath(chained)
    faster.slow_down(times, np.full(200, 0.3))
    assert faster.duration == pytest.approx(path.duration)


SOURCE = make_container_shell(read_inner_size("source")).subdivide_to_size(0.003).vertices


def gap(config: RehearsalConfig, pose: mpm.Pose) -> float:
    """Least distance [m] of the tool at a pose and the source's corners, edges and faces."""
    points = container_pose(config.containers["source"]).apply(SOURCE)
    return float(build_real_tool_sdf(config.tool).distance(pose.inverse().apply(points)).min())


def test_a_tool_is_kept_clear_of_containers(chained, tmp_path):
    """A scoop that goes down and up again: well above the floor it stays as it was learnt, 1 mm into the floor it is
    moved by what is missing, there and nowhere else; where the floor goes through it nothing helps."""
    action = load_task("SpoonScoop").action
    head = np.concatenate([part.vertices for part in tool_shape("spoon").solid()])
    room = LearnedPath(chained).pose(0.0).apply(head)[:, 2].min() - chained.containers["source"].position[2]

    def dipping(depth: float) -> LearnedPath:
        rows = np.outer(np.repeat([-1.0, 1.0], 50), [0.0, 0.0, depth / action.speed, 0.0, 0.0, 0.0])
        np.savez(tmp_path / "SpoonScoop.npz", actions=rows, action_repeat=10)
        return LearnedPath(chained)

    def lowest(path: LearnedPath) -> float:
        return min(gap(chained, path.pose(t)) for t in np.arange(0.0, path.times["SpoonTranslate"], 0.02))

    above, into, through = dipping(room - 0.01), dipping(room + 0.001), dipping(room + 0.04)
    assert above.kept_clear_by == 0.0
    assert 0.009 < lowest(above) < 0.015  # rounding cuts the turning point
    assert CLEAR + 0.0005 < into.kept_clear_by < 1.5 * (0.001 + CLEAR)
    assert lowest(into) > CLEAR - 2.0 * ENOUGH
    for t in (0.3, into.times["SpoonTranslate"] - 0.3, into.duration):
        assert np.array_equal(into.pose(t).matrix, above.pose(t).matrix)
    assert into.pose(into.duration).position == pytest.approx(above.pose(above.duration).position, abs=1e-12)
    assert through.kept_clear_by == 0.0 and lowest(through) < 0.0


def test_excess_is_the_time_that_is_missing():
    """A motion played so many times slower is at its limits, whichever of speed, acceleration and jerk counts."""
    limits, times = load_rehearsal("spoon").limits, np.linspace(0.0, 1.0, 201)
    for size, wave in ((2.0, 1.0), (0.3, 4.0), (0.02, 20.0)):
        q = np.tile(size * np.sin(2.0 * np.pi * wave * times)[:, None], (1, 7))
        most = compute_time_scale(times, q, limits).max()
        assert compute_time_scale(most * times, q, limits).max() == pytest.approx(1.0, abs=1e-6)


def test_joint_trajectory_is_the_motion(chained):
    """Points on the smoothed motion; their speeds are the slopes of their places, but for jerk h^2 / 6."""
    motion = plan(chained).motion
    told = yaml.safe_load(yaml.safe_dump(make_joint_trajectory(motion)))
    assert told["joint_names"] == [f"A{i}" for i in range(1, 8)]
    times = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in told["points"]]
    assert times[0] == 0.0 and times[-1] == pytest.approx(motion.duration, abs=1e-8)
    assert all(b > a for a, b in pairwise(times))
    q, qd = (np.array([p[key] for p in told["points"]]) for key in ("positions", "velocities"))
    assert q[50] == pytest.approx(motion.state(times[50]).q, abs=1e-8)
    slopes = (q[2:] - q[:-2]) / (np.array(times[2:]) - times[:-2])[:, None]
    assert slopes == pytest.approx(qd[1:-1], abs=max(chained.limits.jerk) * 0.01**2 / 6.0)
    assert qd[0] == pytest.approx(0.0, abs=1e-9) and qd[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name, given, told", [
    ("bottle", {"pile": {"centre": [0.7, 0, 0.01], "half": [0.01] * 3}}, "2 places hold material"),
    ("shovel", {"pile": None}, "0 places hold material"),
    ("shovel", {"area": None}, "0 places take material"),
    ("spoon", {"containers": {"bucket": {"position": [0.7, 0, 0]}}}, "unknown 'bucket'; valid: source, target, tray"),
    ("bottle", {"trajectory": "learned", "learned": []}, "needs `learned`"),
    ("bottle", {"weigh_at": "lifted"}, "needs a dwell"),
])
def test_rehearsals_that_are_refused(name, given, told):
    with pytest.raises(ConfigError, match=told):
        load_rehearsal(name, given)


def test_motions_that_do_not_fit_are_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(learned, "trained", lambda name: None)
    with pytest.raises(ConfigError, match="no learnt motion ships for BottlePickPour"):
        learned.placed(load_rehearsal("bottle", {"trajectory": "learned"}))
    with pytest.raises(ConfigError, match="moves a shovel; the rehearsal's tool is bottle"):
        learned.placed(load_rehearsal("bottle", {"trajectory": "learned", "learned": ["ShovelMove"]}))
    motions(tmp_path, "ScoopScoop")
    monkeypatch.setattr(learned, "trained", lambda name: tmp_path / f"{name}.npz")
    config = load_rehearsal("scoop", {"trajectory": "learned", "learned": ["ScoopScoop"]})
    turned = config.model_copy(update={"containers": {
        name: box.model_copy(update={"yaw_deg": 0.0}) for name, box in config.containers.items()}})
    with pytest.raises(ConfigError, match="yaw_deg 90"):
        learned.placed(turned)


def test_material_is_where_it_was_asked_for():
    """In the bottle up to its height and not in its wall; on the table as large as the block. Too much is refused."""
    bottle, rng = load_rehearsal("bottle"), np.random.default_rng(0)
    sdf = build_tool_sdf("bottle", bottle.collision_thickness)
    pose = mpm.Pose(np.array([0.7, 0.1, 0.3]), np.array([1.0, 0.0, 0.0, 0.0]))
    places, volume = fill(bottle, sdf, pose, rng)
    local, region = places - pose.position, tool_shape("bottle").interior
    assert region.holds(local).all() and (sdf.distance(local) > 0).all()
    height = local[:, 2].max() - (region.centre[2] - region.half[2])
    assert height == pytest.approx(bottle.tool_fill_height, abs=0.005)
    # a body of 3 cm radius, filled to some 5 cm above its floor
    assert volume * len(places) == pytest.approx(np.pi * 0.03**2 * 0.052, rel=0.15)
    shovel = load_rehearsal("shovel")
    places, volume = fill(shovel, sdf, pose, rng)
    assert volume * len(places) == pytest.approx(0.05 * 0.05 * 0.015, rel=1e-9)
    assert (np.abs(places - shovel.pile.centre) <= np.array(shovel.pile.half) + 1e-12).all()
    with pytest.raises(ConfigError, match="tool_fill_height = 0.2 m; accepted: up to"):
        check_field(load_rehearsal("bottle", {"tool_fill_height": 0.2}), mpm.Elastic(E=1e5, nu=0.2, density=1000.0))


@pytest.mark.parametrize("name", ["spoon", "scoop", "bottle", "shovel"])
def test_every_script_can_be_planned(name):
    """Within the arm's limits, its joints inside their ranges; the field takes every granular material that ships."""
    config = load_rehearsal(name)
    assert plan(config).solution.margin > 0.01
    for material in ("salt", "sugar", "flour", "sand", "paper"):
        check_field(config, law_of(load_material(material)))


def test_the_scoops_learnt_motions_are_within_reach():
    """The longest of the learnt ways; beside the arm's middle its tray was out of reach by 5 mm."""
    planned = plan(learned.placed(load_rehearsal("scoop", {"trajectory": "learned"})))
    assert planned.solution.margin > 0.01 and planned.path.slower_by < 1.5


def test_a_rehearsal_knows_what_its_motions_need():
    """A full tool, a pile, a filled container; the area goes where the motion goes."""
    with pytest.raises(ConfigError, match="begins with a full spoon"):
        learned.placed(load_rehearsal("spoon", {"trajectory": "learned", "learned": ["SpoonTranslate"]}))
    shovel = load_rehearsal("shovel", {"trajectory": "learned",
                                       "pile": {"centre": [0.70, -0.08, 0.0075], "half": [0.02, 0.02, 0.0075]}})
    task, moved = load_task("ShovelMove"), learned.placed(shovel)
    assert moved.area.centre[:2] == pytest.approx(np.array(task.target.centre[:2]) + [-0.08, 0.02])
    path = LearnedPath(moved)
    begin = path.pose(0.0).position - task.start.position
    assert begin == pytest.approx([-0.08, 0.02, 0.0], abs=1e-9)
    assert learned.placed(load_rehearsal("shovel")) == load_rehearsal("shovel")


def test_a_motion_ends_where_its_work_is_done(tmp_path):
    """A pour is cut after the decisions that it needed; a carry is not: its tool is held level to the end."""
    for name, seconds in (("SpoonPour", 0.6), ("SpoonTranslate", 2.0)):
        motions(tmp_path, name)
        with np.load(tmp_path / f"{name}.npz") as stored:
            np.savez(tmp_path / f"{name}.npz", **stored, needed=30)
        found = learned.motion_of(tmp_path / f"{name}.npz", name, load_task(name))
        assert len(found.places) - 1 == round(seconds / SAMPLING)
        assert found.places[-1, 1] - found.places[0, 1] == pytest.approx(0.02 * seconds, abs=1e-9)
    np.savez(tmp_path / "SpoonPour.npz", actions=np.zeros((100, 3)), action_repeat=10)
    with pytest.raises(ConfigError, match=r"SpoonPour.npz: not a motion of SpoonPour: .*shape \(3,\)"):
        learned.motion_of(tmp_path / "SpoonPour.npz", "SpoonPour", load_task("SpoonPour"))


def test_what_is_in_the_tool_is_not_delivered():
    """Grains over the area count once they have left the bottle; a shovel's blade may stay before them."""
    for name, there in (("bottle", (1.0 / 3.0, 1.0 / 3.0)), ("shovel", (2.0 / 3.0, 0.0))):
        config = load_rehearsal(name)
        middle = np.array(tool_shape(name).interior.centre)
        pose = mpm.Pose(np.array(config.area.centre) - middle, np.array([1.0, 0.0, 0.0, 0.0]))
        beside = np.array(config.area.centre) + [0.0, 0.045, 0.0]
        run = SimpleNamespace(config=config, scooped=np.ones(3, bool), tool_pose=lambda pose=pose: pose,
                              solver=SimpleNamespace(masses=lambda: np.ones(3)))
        found = fates(run, np.array([config.area.centre, beside, [0.0, 0.0, 0.0]]))
        assert (found["delivered_fraction"], found["retained_fraction"]) == pytest.approx(there)
        assert found["spilled_fraction"] == pytest.approx(1.0 / 3.0)

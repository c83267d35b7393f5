"""Recorded motions as paths of the arm: sequence, smoothing, time scaling, clearance."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mpm
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.planning.plan import plan_motion
from robosim.planning.recorded_motions import place_target
from robosim.planning.recorded_path import (
    CLEARANCE,
    CONNECTION_SPEED,
    SHIFT_TOLERANCE,
    SMOOTHING,
    WEIGHING_TIME,
    RecordedPath,
)
from robosim.scene.container_clearance import build_real_tool_sdf
from robosim.scene.models import read_inner_size
from robosim.shapes import tool_shape
from robosim.shapes.containers import make_container_shell
from robosim.tasks.task import load_task


def test_each_motion_begins_where_the_one_before_ends(chained):
    """Each moves 4 cm along y, from the position over the source on; height and attitude are the motion's own.

    The target container stands where the last one pours."""
    tasks = [load_task(name) for name in chained.recorded]
    path = RecordedPath(chained)
    offset = np.array(chained.containers["source"].position) - tasks[0].containers["source"].position
    begin = np.array(tasks[0].start.position) + offset
    for k, task in enumerate(tasks):
        pose = path.pose(path.times[chained.recorded[k]])
        assert pose.position[:2] == pytest.approx(begin[:2] + [0.0, 0.04 * k], abs=2e-3)
        assert pose.position[2] == pytest.approx(task.start.position[2] + offset[2] * (k == 0), abs=2e-3)
        angle = Rotation.from_matrix(pose.matrix.T @ task.start.pose.matrix).magnitude()
        assert angle < np.radians(2.0)
    pour_point = np.array(tasks[2].target.centre[:2]) + (begin[:2] + [0.0, 0.08] - tasks[2].start.position[:2])
    assert chained.containers["target"].position[:2] == pytest.approx(pour_point, abs=1e-9)
    assert chained.containers["source"] == load_rehearsal("spoon").containers["source"]
    begin, end = path.rests[chained.weigh_at]
    assert path.times["SpoonScoop"] + 2.0 < begin < end < path.times["SpoonTranslate"]
    assert path.pose(begin).position == pytest.approx(path.pose(end).position, abs=1e-9)
    assert end - begin == pytest.approx(WEIGHING_TIME)


def test_the_path_has_no_speed_jumps(chained):
    """Where a motion changes from v to -v at once, accelerations are at most 2 v / SMOOTHING."""
    path = RecordedPath(chained)
    times = np.arange(0.0, path.duration, 0.01)
    positions = np.array([path.pose(t).position for t in times])
    speed = np.diff(positions, axis=0) / 0.01
    assert np.abs(np.diff(speed, axis=0)).max() / 0.01 < 2.0 * CONNECTION_SPEED / SMOOTHING
    assert path.smoothing_deviation < 0.25 * CONNECTION_SPEED * SMOOTHING
    tip = np.array([0.03, 0.0, 0.0])
    for t in (0.5, 0.5 * path.duration):
        pose = path.pose(t)
        measured = np.concatenate([pose.position, pose.apply(tip[None])[0]])
        assert np.abs(path.sample_near(t, tip) - measured).max(1).min() < 1e-3


def test_slowing_down_keeps_the_positions(chained):
    """With twice the duration the same positions follow at twice the time, within the smoothing deviation."""
    path, slow = RecordedPath(chained), RecordedPath(chained)
    times = np.linspace(0.0, path.duration, 200)
    slow.slow_down(times, np.full(200, 2.0))
    assert slow.duration == pytest.approx(2.0 * path.duration, rel=1e-3)
    assert slow.time_scale == pytest.approx(2.0, rel=1e-2)
    for t in times[::20]:
        allowed = 2.0 * path.smoothing_deviation + 1e-6
        assert slow.pose(2.0 * t).position == pytest.approx(path.pose(t).position, abs=allowed)
    assert slow.smoothing_deviation < 0.7 * path.smoothing_deviation
    faster = RecordedPath(chained)
    faster.slow_down(times, np.full(200, 0.3))
    assert faster.duration == pytest.approx(path.duration)


SOURCE = make_container_shell(read_inner_size("source")).subdivide_to_size(0.003).vertices


def compute_gap(config: RehearsalConfig, pose: mpm.Pose) -> float:
    """Compute the least distance [m] between the tool at a pose and points on the source container."""
    points = config.containers["source"].pose.apply(SOURCE)
    return float(build_real_tool_sdf(tool_shape(config.tool)).distance(pose.inverse().apply(points)).min())


@pytest.mark.slow
def test_the_path_is_shifted_away_from_containers(chained, tmp_path):
    """A spoon goes down to the floor of the container and up again.

    A path well above the floor is unchanged; one 1 mm into it is shifted by what is missing, and only there; one whose
    floor is in the middle of the bowl needs more than the largest shift and is unchanged."""
    action = load_task("SpoonScoop").action
    head = tool_shape("spoon").mesh.vertices
    height = RecordedPath(chained).pose(0.0).apply(head)[:, 2].min() - chained.containers["source"].position[2]

    def make_path(depth: float) -> RecordedPath:
        rows = np.outer(np.repeat([-1.0, 1.0], 50), [0.0, 0.0, depth / action.speed, 0.0, 0.0, 0.0])
        np.savez(tmp_path / "SpoonScoop.npz", actions=rows, action_repeat=10)
        return RecordedPath(chained)

    def least_gap(path: RecordedPath) -> float:
        return min(compute_gap(chained, path.pose(t)) for t in np.arange(0.0, path.times["SpoonTranslate"], 0.02))

    above, into, through = make_path(height - 0.01), make_path(height + 0.001), make_path(height + 0.04)
    assert above.clearance_shift == 0.0
    assert 0.009 < least_gap(above) < 0.015  # smoothing cuts the turning point
    assert CLEARANCE + 0.0005 < into.clearance_shift < 1.5 * (0.001 + CLEARANCE)
    assert least_gap(into) > CLEARANCE - 2.0 * SHIFT_TOLERANCE
    for t in (0.3, into.times["SpoonTranslate"] - 0.3, into.duration):
        assert np.array_equal(into.pose(t).matrix, above.pose(t).matrix)
    assert into.pose(into.duration).position == pytest.approx(above.pose(above.duration).position, abs=1e-12)
    assert through.clearance_shift == 0.0 and least_gap(through) < 0.0


@pytest.mark.slow
def test_the_scoops_bundled_motions_are_within_reach():
    """They go farthest: with the container at the arm's side the tray was out of reach by 5 mm."""
    plan = plan_motion(place_target(load_rehearsal("scoop", {"trajectory": "recorded"})))
    assert plan.solution.margin > 0.01 and plan.path.time_scale < 1.5

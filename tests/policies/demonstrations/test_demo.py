"""Demonstrations: actions and twists, searches, and `demonstrate`."""

import json

import gymnasium
import numpy as np
import pytest
from filelock import FileLock

import mpm
from mpm.geometry.rigid_motion import rotation_matrix
from policies.demonstrations import demo
from policies.demonstrations.action_repeat import ActionRepeat
from policies.demonstrations.demo import demonstrate
from policies.demonstrations.descent import Descent
from policies.demonstrations.gradients import gradients
from policies.demonstrations.motion_loss import MotionLoss
from policies.demonstrations.spline_search import SplineSearch
from policies.learning.options import SearchOptions
from robosim.base.errors import ConfigError
from robosim.base.output_folder import LOCK
from robosim.envs.reach import Reach
from robosim.studies.evaluation.evaluate import evaluate
from robosim.tasks.actions import follow
from robosim.tasks.task import load_task


def test_adjoint_of_the_map_from_actions_to_twists():
    """Against central differences, with steps that the box clips."""
    motion = ActionRepeat(load_task("SpoonPour"), 10)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-0.6, 0.9, (motion.decisions, 6))
    linear, angular = motion.to_twists(actions)
    assert linear.shape == angular.shape == (1000, 3)
    positions = motion.start + motion.dt * linear.cumsum(0)
    assert np.all(positions <= motion.upper + 1e-12) and not motion.unclipped.all()
    W, U = rng.standard_normal((1000, 3)), rng.standard_normal((1000, 3))
    bars = motion.pull_back(W, U)
    for _ in range(20):
        direction = rng.standard_normal(actions.shape)
        ends = []
        for s in (1e-7, -1e-7):
            v, w = motion.to_twists(actions + s * direction)
            ends.append(np.sum(W * v) + np.sum(U * w))
        motion.to_twists(actions)
        assert np.sum(bars * direction) == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-5, abs=1e-4)


def test_first_actions_follow_the_script_and_rest():
    """The tool reaches the script's pose at the given time, and stays there; displacements close in time."""
    task = load_task("SpoonScoop")
    motion = ActionRepeat(task, 10)
    actions = demo.first_actions("script", 0.74, task, motion)
    linear, angular = motion.to_twists(actions)
    assert not actions[37:].any() and not linear[370:].any()
    script, matrix = task.scripted_path(), task.start.pose.matrix
    for w in angular[:370]:
        matrix = rotation_matrix(task.step_dt * w) @ matrix
    position = np.array(task.start.position) + task.step_dt * linear.sum(0)
    assert position == pytest.approx(script.pose(0.74).position, abs=1e-9)
    assert matrix == pytest.approx(script.pose(0.74).matrix, abs=1e-9)
    on, away = script.pose(0.3), script.pose(9.0)._replace(position=script.pose(9.0).position + [0.004, 0.0, 0.0])
    assert follow(task, script, on, 0.3, 0.02, 0.1) == pytest.approx(follow(task, script, on, 0.3, 0.02), abs=1e-9)
    closed = 0.02 * task.action.speed * follow(task, script, away, 9.0, 0.02, 0.1)[:3]
    assert closed == pytest.approx([-0.2 * 0.004, 0.0, 0.0], abs=1e-12)  # 0.02 s of a time constant of 0.1 s
    for given, until in ((None, 0.5), ("script", 2.1), ("script", 0.0), ("actions.npz", 0.5)):
        with pytest.raises(mpm.InvalidValue, match="--until"):
            demo.first_actions(given, until, task, motion)


def test_descent_continues_from_a_state():
    """On a valley whose sides differ by a factor of a hundred; a stored state gives the same steps to the bit."""
    scale = np.array([1.0, 100.0])

    def slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        return float(np.sum(scale * (x - 0.3) ** 2)), 2.0 * scale * (x - 0.3)

    one, two = (Descent(np.zeros((4, 2)), 0.05) for _ in range(2))
    for _ in range(40):
        one.step(*slope(one.now))
    two.load(one.state())
    for _ in range(60):
        one.step(*slope(one.now))
        two.step(*slope(two.now))
    assert np.array_equal(one.now, two.now) and np.abs(one.now).max() <= 1.0
    assert one.lowest == two.lowest < 1e-3


def test_descent_leaves_a_point_with_a_misleading_gradient():
    """Within a hundredth of the start the gradient has the wrong sign, as at a kink; fixed rows stay there."""
    first = np.zeros((20, 2))

    def slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        right = 1.0 if np.abs(x[5:]).max() > 0.01 else -1.0
        return float(np.sum((x[5:] - 0.3) ** 2)), right * 2.0 * (x - 0.3)

    search = Descent(first, 0.002, fixed=5)
    for _ in range(400):
        search.step(*slope(search.now))
        assert np.array_equal(search.now[:5], first[:5])
    assert search.lowest < 0.5 * slope(first)[0]


@pytest.mark.parametrize("make_search", [lambda first: Descent(first, 0.05, fixed=5),
                                         lambda first: SplineSearch(first, seed=0, fixed=5)])
def test_fixed_actions_stay(make_search):
    """To the bit; the others reach the minimum."""
    first = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    search = make_search(first)
    for _ in range(400):
        offset = search.now - 0.3
        search.step(float(np.sum(offset[5:] ** 2)), 2.0 * offset)
        assert np.array_equal(search.now[:5], first[:5])
    assert np.array_equal(search.best[:5], first[:5])
    assert search.best[5:] == pytest.approx(np.full((15, 2), 0.3), abs=0.2)


def test_spline_search_continues_from_its_losses():
    """It finds a minimum within its bounds; from the same losses it proposes the same motions."""
    target = np.linspace(-0.5, 0.8, 20)[:, None] * [1.0, -1.0]

    def loss(actions: np.ndarray) -> float:
        return float(np.mean((actions - target) ** 2))

    one, two = (SplineSearch(np.zeros((20, 2)), seed=3) for _ in range(2))
    losses = []
    for _ in range(255):
        losses.append(loss(one.now))
        one.step(losses[-1])
    two.load(one.state())
    assert np.array_equal(one.now, two.now)
    for search in (one, two):
        for _ in range(300):
            search.step(loss(search.now))
    assert np.array_equal(one.best, two.best) and one.lowest == two.lowest < 0.01 * losses[0]
    assert len(one.convergence_losses(losses)) == 25 and one.convergence_losses(losses)[-1] == min(losses[:250])


def test_demands_on_the_arm():
    """The penalty's derivatives against central differences; a slow motion costs nothing; a fast one has a
    time at which it passes a limit; the arm moves the tool to where it was commanded to be."""
    task = load_task("SpoonPour")
    reach, start, rng = Reach(task), task.start.pose, np.random.default_rng(0)
    linear, angular = (np.repeat(rng.normal(0.0, s, (6, 3)), 10, axis=0) for s in (0.6, 4.0))
    value, bars = reach.penalty(start, linear, angular)
    assert value > 1.0
    for _ in range(20):
        directions = rng.standard_normal((2, 60, 3))
        ends = [reach.penalty(start, linear + s * directions[0], angular + s * directions[1])[0] for s in (1e-5, -1e-5)]
        slope = np.sum(bars[0] * directions[0]) + np.sum(bars[1] * directions[1])
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-7)
    slow = reach.penalty(start, 0.02 * linear, 0.02 * angular)
    assert slow[0] == 0.0 and not np.any(slow[1])
    fast, calm = (reach.readings(start, s * linear, s * angular) for s in (1.0, 0.05))
    assert fast["speed_limit_ratio_max"] > 1.0 and 0.0 <= fast["first_violation_time_s"] <= 0.12
    assert calm["first_violation_time_s"] == -1.0 and calm["end_position_error_m"] < 1e-4


def make(out, n: int = 1, jobs: int = 1, iterations: int = 3, **options) -> int:
    search = SearchOptions(iterations=iterations, **options)
    return demonstrate("SpoonTranslate", out, search, n=n, jobs=jobs, film=False)


def names(folder) -> set[str]:
    return {path.name for path in folder.glob("[!.]*")}


@pytest.mark.slow
def test_a_demonstration_is_made_stored_and_recognised(tmp_path, monkeypatch):
    """Three iterations lower the loss; a run that is killed after two and resumed ends with the same bits; a finished
    one is not made again; another seed, start or rate in the same folder is refused."""
    whole, cut, name = tmp_path / "whole", tmp_path / "cut", "demonstration_0.npz"
    assert make(whole) == 1, "three iterations reach nothing"
    arrays = dict(np.load(whole / name))
    assert arrays["actions"].shape == (100, 3) and len(arrays["losses"]) == 3 and np.isfinite(arrays["check"]).all()
    assert arrays["losses"][2] < arrays["losses"][0]
    assert names(whole) == {name, "demonstrations.json", "status.json"}
    row = json.loads((whole / "demonstrations.json").read_text())["demonstrations"][0]
    assert evaluate("SpoonTranslate", str(whole / name), tmp_path / "again", episodes=1, film=False) == 0
    again = json.loads((tmp_path / "again" / "evaluation.json").read_text())
    assert again["tcs"] == pytest.approx(row["among grains of salt"]["tcs"], abs=1e-9)
    real, calls = MotionLoss.value_and_grad, []

    def killed(self, actions):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(self, actions)

    monkeypatch.setattr(MotionLoss, "value_and_grad", killed)
    with pytest.raises(KeyboardInterrupt):
        make(cut)
    assert (cut / "demonstration_0.unfinished.npz").is_file()
    calls.extend([1] * 10)
    assert make(cut) == 1 and names(cut) == names(whole)
    stored = np.load(cut / name)
    assert all(np.array_equal(stored[key], arrays[key]) for key in ("actions", "losses"))
    monkeypatch.setattr(MotionLoss, "value_and_grad", None)  # not called again
    for given in ({"seed": 1}, {"nominal": True}, {"rate": 0.01}, {"start": whole / name}):
        with pytest.raises(mpm.InvalidValue, match="made for another"):
            make(whole, **given)


@pytest.mark.parametrize("given, message", [({"iterations": 0}, "--iterations 0"), ({"seed": -1}, "--seed -1"),
                                            ({"rate": 2.0}, "--rate 2")])
def test_wrong_options_are_refused(given, message):
    with pytest.raises(mpm.InvalidValue, match=message):
        SearchOptions(**given)


def test_a_folder_is_locked(tmp_path):
    with FileLock(tmp_path / LOCK), pytest.raises(ConfigError, match="another process is at work"):
        make(tmp_path)


@pytest.mark.slow
def test_a_search_from_rest_empties_the_tool_over_the_target(tmp_path):
    """In the fluid that is searched in, and with the same motion among grains: no full tool that waits above."""
    assert demonstrate("SpoonPour", tmp_path, SearchOptions(nominal=True), n=1, film=False) == 0
    (row,) = json.loads((tmp_path / "demonstrations.json").read_text())["demonstrations"]
    assert row["in glycerol"]["is_success"] and row["among grains of salt"]["is_success"]


@pytest.mark.slow
def test_two_workers_make_the_same_demonstrations(tmp_path):
    """To the bit."""
    for jobs in (1, 2):
        assert make(tmp_path / str(jobs), n=2, jobs=jobs, iterations=2) == 1
    for k in range(2):
        one, two = (np.load(tmp_path / jobs / f"demonstration_{k}.npz") for jobs in "12")
        assert all(np.array_equal(one[what], two[what]) for what in ("actions", "losses", "check"))
    assert names(tmp_path / "1") == names(tmp_path / "2")


@pytest.mark.slow
def test_an_arm_has_no_rollout():
    with pytest.raises(ValueError, match="mobile"):
        gymnasium.make("robosim/SpoonTranslate-v0", arm=True).unwrapped.rollout(10)


@pytest.mark.slow
def test_growth_of_derivatives_is_stored_and_recognised(tmp_path):
    """Derivatives up to a hundred steps before the end agree with differences in clay, but for grains at nodes that
    newly touch the tool (3 to 7 %); stored results are not computed again."""
    assert gradients(["ShovelMove"], tmp_path, jobs=2) == 0
    rows = {row["variant"]: row for row in json.loads((tmp_path / "gradients.json").read_text())}
    near = {check.pop("steps_before_the_end"): check for check in rows["fluid or clay"]["checks"]}
    for back in (10, 30, 100):
        assert near[back]["derivative"] == pytest.approx(near[back]["difference"], rel=0.1)
    assert rows["grains"]["growth"] > 100 * rows["fluid or clay"]["growth"]
    page = (tmp_path / "index.html").read_text()
    assert "ShovelMove: " in page and all(f'"name":"{variant}"' in page for variant in rows)
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "rows").glob("*.json")}
    assert len(files) == 4 and gradients(["ShovelMove"], tmp_path) == 0
    assert files == {path: path.stat().st_mtime_ns for path in files}

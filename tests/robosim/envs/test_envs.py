"""The environments: Gymnasium's rules, the paper's scores at their extremes, determinism, one physics everywhere."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from grain_envs import make, observe, play
from gymnasium.utils.env_checker import check_env

import mpm
from robosim.base.resources import config_names
from robosim.config.materials import load_material
from robosim.envs import BUNDLED, DOSING, TASKS, sub_tasks
from robosim.envs.grain_env import GrainEnv
from robosim.scene.grains import grain_volume
from robosim.shapes import tool_shape
from robosim.studies.policies.make import make_policy
from robosim.tasks.outcome import build_outcome, build_reward
from robosim.tasks.task import load_task

EXTREMES = {"SpoonTranslate": (-41.00, 41.00), "ScoopTranslate": (-44.10, 44.10), "ShovelMove": (-41.70, 41.70),
            "SpoonPour": (-30.45, 52.78), "ScoopPour": (-39.60, 72.60), "BottlePickPour": (-26.60, 46.55)}
"""TCS of no motion and of a perfect one: the tables of arXiv 2406.09178, and for what they lack its equations."""
MOST = [pytest.param(name, marks=() if name == "SpoonPour" else pytest.mark.slow) for name in TASKS]


@pytest.fixture(scope="module")
def pour() -> GrainEnv:
    return make("SpoonPour")


@pytest.fixture(scope="module")
def scoop() -> GrainEnv:
    return make("SpoonScoop")


def test_every_task_has_an_environment_with_a_page() -> None:
    assert sorted(BUNDLED) == config_names("tasks")
    for name in (*TASKS, *DOSING):
        page, task = getattr(sub_tasks, name).__doc__, load_task(name)
        if task.dose is None:
            facts = (str(task.reward["target"].model_dump()), f"{build_reward(task).extremes()[0]:.2f}",
                     str(task.action.speed), str(task.target.centre))
        else:
            point = 1e3 * load_material(task.material).density.value * grain_volume(task)
            facts = (f"weighs {point:.3g} g", f"between {task.dose.target_g[0]:g} and",
                     f"{task.dose.tolerance_percent:g} % or {task.dose.tolerance_g:g} g")
        for fact in (str(task.grains.count), *facts):
            assert fact in page, (name, fact)


@pytest.mark.long
def test_the_page_has_the_bounds_of_the_spaces(pour: GrainEnv) -> None:
    page = type(pour).__doc__ or ""
    low, high = pour.observation_space.low, pour.observation_space.high  # pyright: ignore[reportAttributeAccessIssue]
    assert f"`Box({low.shape}, float32)`" in page
    for part in (slice(0, 3), slice(3, 6), slice(-8, -5)):  # position and velocity of a grain, position of the tool
        for bound in (low[part], high[part]):
            assert f"({', '.join(f'{value:.3g}' for value in bound)})" in page


@pytest.mark.parametrize("name", EXTREMES)
def test_extremes_follow_from_counts_and_weights_and_a_perfect_motion_scores_the_upper(name: str) -> None:
    """All grains reach the target, in the last step or, where they are poured, in one on the way."""
    task = load_task(name)
    assert build_reward(task).extremes() == pytest.approx(EXTREMES[name], abs=1e-9)
    reward, outcome, n = build_reward(task), build_outcome(task), task.grains.counted
    poured = n if "poured" in task.reward else 0
    none = mpm.Counts(0.0, 0, 0, 0, 0, n, 0, 0, 1.0)
    way = none._replace(newly_exited=poured, exited_from_region=poured, exited=poured, in_region=n)
    total = sum(sum(reward.step(outcome.step(now, task.start.pose, 0.0, now is way)).values()) for now in (none, way))
    assert reward.tcs == pytest.approx(EXTREMES[name][1], abs=1e-9)
    assert total == pytest.approx(reward.tcs + 2 * task.reward["distance"].total / task.steps)
    assert outcome.is_success(way, outcome.readings(way))


@pytest.mark.long
@pytest.mark.parametrize("name", MOST)
def test_no_motion_scores_the_lower_extreme_and_the_script_succeeds(name: str, request: Any) -> None:
    fixture = {"SpoonPour": "pour", "SpoonScoop": "scoop"}.get(name)
    env = request.getfixturevalue(fixture) if fixture else make(name)
    for seed in (0, 1):
        _, info, seen = play(env, "zero", seed)
        assert info["tcs"] == pytest.approx(env.reward.extremes()[0], abs=1e-9) and not info["is_success"]
    assert np.ptp(np.array(seen), axis=0)[-1] == pytest.approx(1.0)
    _, info, seen = play(env, "scripted", 0)
    assert info["is_success"] and info["tcs"] > 0.8 * env.reward.extremes()[1]
    assert info["tcs"] == pytest.approx(sum(info["tcs_terms"].values()))
    seen += play(env, "random", 0)[2]  # a script may leave a height as it is
    moved, slices = np.ptp(np.array(seen), axis=0) > 0, env.observation_slices
    # nothing that is observed stays constant; a coordinate of a grain deep in a heap may
    assert moved[slices["particles"]].reshape(-1, 6).any(axis=1).all()
    assert moved[slices["tool"]].all() and moved[slices["time"]].all()


@pytest.mark.long
@pytest.mark.parametrize("arm", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", [*MOST, pytest.param("DoseSpoon", marks=pytest.mark.slow)])
def test_gymnasium_and_stable_baselines_have_no_complaint(name: str, arm: bool) -> None:
    """A warning is an error in all tests; lists of terms are checked in tests/robosim/senses."""
    env = make(name, obs=None if name in DOSING else "moments", arm=arm)
    check_env(env, skip_render_check=True)
    if name not in DOSING:
        pytest.importorskip("stable_baselines3.common.env_checker").check_env(env, skip_render_check=True)


def test_same_seed_same_bits_and_seeds_differ(pour: GrainEnv) -> None:
    first, again, other = (play(pour, "random", seed)[2] for seed in (3, 3, 4))
    assert all(np.array_equal(a, b) for a, b in zip(first, again))
    assert not np.array_equal(first[0], other[0])
    assert first[0] is not first[1] and not np.shares_memory(first[0], first[1])
    nominal = [pour.reset(seed=s, options={"nominal": True})[0] for s in (1, 2)]
    assert np.array_equal(*nominal)


def test_the_score_does_not_depend_on_the_action_repeat(pour: GrainEnv) -> None:
    """The same commands given in steps of 20 and of 2 ms: the same physics, launch by launch or in one."""
    commands, act = [], make_policy("scripted", pour, 0)
    total, info, _ = play(pour, lambda seen: commands.append(act(seen)) or commands[-1])
    places = pour.solver.positions()
    pour.action_repeat = 1
    try:
        pour.reset(seed=0)
        again = sum(float(pour.step(commands[k // 10])[1]) for k in range(1000))
    finally:
        pour.action_repeat = 10
    assert again == pytest.approx(total, abs=1e-6)
    assert pour.reward.tcs == pytest.approx(info["tcs"])
    assert np.array_equal(pour.solver.positions(), places)


@pytest.mark.long
def test_reward_of_scooping_agrees_with_plain_numpy(scoop: GrainEnv) -> None:
    """Random states: elites, target, contact, collision and turn, against the paper's equation written out."""
    task, rng = scoop.task, np.random.default_rng(0)
    weights: Any = SimpleNamespace(**task.reward)
    for _ in range(5):
        scoop.reset(seed=0)
        state = scoop.solver.state()
        region = rng.uniform(task.field.region_lower, task.field.region_upper, (task.grains.count, 3))
        state["x"] = region - scoop.solver.grid.origin
        scoop.solver.load(state)
        scoop.counter.restart()
        now = scoop.counter.read()
        terms = scoop.reward.step(scoop.episode.outcome.step(now, task.start.pose, -1.5, True))
        x = scoop.solver.positions()
        distance = np.abs(x - task.goal) @ weights.distance.weights
        elite = np.argsort(distance)[: task.grains.elites]
        beta = weights.distance.total / (task.steps * 300 * weights.distance.reference)
        assert terms["distance"] == pytest.approx(beta * (300 * weights.distance.reference - distance[elite].sum()),
                                                  rel=1e-6)
        assert terms["target"] == pytest.approx(
            weights.target.weight * np.where(task.target.region.holds(x[elite]), 1.0, -1.0).sum())
        assert terms["turn"] == pytest.approx(15 * (2.0 - abs(-1.5 + np.radians(110))))
        tool = scoop.solver.collider_pose(0)
        phi = scoop.solver.colliders[0].sdf.distance(tool.inverse().apply(x))
        assert terms["contact"] == pytest.approx(weights.contact.weight * (phi < 0.004).sum(),
                                                 abs=2 * weights.contact.weight)
        assert terms["lost"] == 0.0 and terms["collision"] == 0.0


def test_reward_of_pouring_agrees_with_plain_numpy(pour: GrainEnv) -> None:
    """Grains jump from one random state to the next: who crossed the bounds, and whether it was over the target."""
    task, rng = pour.task, np.random.default_rng(1)
    weights: Any = SimpleNamespace(**task.reward)
    bounds, target = task.bounds.region, task.target.region

    def jump() -> np.ndarray:
        state = pour.solver.state()
        low, high = np.array(task.field.region_lower), np.array(task.field.region_upper)
        state["x"] = rng.uniform(low, high - [0, 0, 0.25], (task.grains.count, 3)) - pour.solver.grid.origin
        pour.solver.load(state)
        return pour.solver.positions()

    for _ in range(5):
        pour.reset(seed=0)
        before = jump()
        pour.counter.restart()
        after = jump()
        now = pour.counter.read()
        terms = pour.reward.step(pour.episode.outcome.step(now, task.start.pose, 0.0, True))
        tool = pour.solver.collider_pose(0).inverse()
        out, ahead = (~bounds.holds(x) & ~tool_shape("spoon").interior.holds(tool.apply(x)) for x in (before, after))
        crossed = ahead & ~out
        assert crossed.sum() > 5
        signs = np.where(target.holds(before[crossed]), 1.0, -1.0)
        assert terms["target"] == pytest.approx(weights.target.weight * signs.sum())
        assert terms["poured"] == pytest.approx(weights.poured.weight * np.where(out | ahead, 1.0, -1.0).sum())
        distance = (np.abs(after - task.goal) @ weights.distance.weights).sum()
        gamma = 203 * weights.distance.reference
        assert terms["distance"] == pytest.approx(weights.distance.total / (1000 * gamma) * (gamma - distance),
                                                  rel=1e-6)


@pytest.mark.parametrize("repeat", [300, 1000])
def test_any_action_repeat_is_possible(pour: GrainEnv, repeat: int) -> None:
    pour.action_repeat = repeat
    try:
        _, info, seen = play(pour, "zero")
        assert info["tcs"] == pytest.approx(-30.45) and info["time"] == pytest.approx(2.0)
        assert len(seen) == 1 + -(-1000 // repeat)
    finally:
        pour.action_repeat = 10


def test_divergence_never_pays(pour: GrainEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last good observation, a score at the lower extreme, no success; and the next episode is whole."""
    total, _, _ = play(pour, "zero")
    pour.reset(seed=0)
    last = pour.step(np.zeros(6, np.float32))[0]
    with monkeypatch.context() as patch:
        patch.setattr(pour.solver, "advance", lambda *a, **k: (_ for _ in ()).throw(mpm.SimulationDiverged(
            time=0.0, step=0, particle=0, position=(0, 0, 0), speed=1e3, cfl=9.0)))
        seen, reward, ended, cut, info = pour.step(np.zeros(6, np.float32))
    assert ended and not cut and not info["is_success"] and "particle 0" in info["diverged"]
    assert info["tcs"] <= -30.45 and reward < total
    assert np.array_equal(seen, last)
    assert play(pour, "zero")[1]["tcs"] == pytest.approx(-30.45)


@pytest.mark.parametrize(("layout", "length"), [
    ("flat", 203 * 6 + 8), ("all", 203 * 6 + 8), ("positions", 203 * 3 + 8), ("velocities", 203 * 3 + 8), ("none", 8),
    ("moments", 30 + 8),
])
def test_layouts_are_flat_and_stay_within_their_bounds(pour: GrainEnv, layout: Any, length: int) -> None:
    pour.reset(seed=0)
    act = make_policy("random", pour, 0)
    for _ in range(5):
        for _ in range(4):
            pour.step(act(pour.observation))
        perception, seen = observe(pour, layout)
        assert seen.shape == (length,) and seen.dtype == np.float32 and perception.space.contains(seen)
        assert sum(part.stop - part.start for part in perception.slices.values()) == length
    assert layout != "moments" or perception.slices["centre"] == slice(0, 3)


def test_the_dict_layout_has_the_numbers_that_the_slices_name(pour: GrainEnv) -> None:
    observation, _ = pour.reset(seed=5)
    perception, table = observe(pour, "dict")
    assert perception.space.contains(table)
    for name, where in pour.observation_slices.items():
        assert np.array_equal(observation[where], table[name].ravel())
    grains = table["particles"].reshape(-1, 6)
    assert grains[:, :3] == pytest.approx(pour.solver.positions(), abs=1e-6)
    assert grains[:, 3:] == pytest.approx(pour.solver.velocities(), abs=1e-6)
    assert table["tool"].ravel()[:3] == pytest.approx(pour.solver.collider_pose(0).position, abs=1e-6)
    assert table["time"] == 0.0

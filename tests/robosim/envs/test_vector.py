"""Vector environments: each behaves as it does alone, in one process or two, and ends or diverges alone."""

import json
import os
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from exact_sums import compare_exactly
from grain_envs import make_vector, same
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

from robosim.base.errors import ConfigError, RobosimError, UnknownName
from robosim.envs.vector import GrainVectorEnv


@pytest.fixture(scope="module")
def carried() -> Iterator[gymnasium.vector.VectorEnv]:
    """Three environments of the smallest sub-task, in this process; seven long actions make an episode."""
    vector = make_vector("SpoonTranslate", action_repeat=150)
    yield vector
    vector.close()


def actions(vector: gymnasium.vector.VectorEnv, seed: int) -> Iterator[np.ndarray]:
    rng = np.random.default_rng(seed)
    while True:
        yield rng.uniform(-0.3, 0.3, vector.action_space.shape).astype(np.float32)  # pyright: ignore[reportArgumentType]


def of(infos: dict[str, Any], e: int) -> dict[str, Any]:
    """The info of one environment."""
    return {key: of(value, e) if isinstance(value, dict) else value[e] for key, value in infos.items()
            if not key.startswith("_") and infos.get(f"_{key}", np.ones(9))[e]}


@pytest.mark.long
@pytest.mark.parametrize(("name", "options"), [
    ("SpoonTranslate", {"obs": "moments", "randomize": {"friction_angle_deg": (20.0, 40.0)}}),
    *(pytest.param(name, options, marks=pytest.mark.slow) for name, options in (
        ("SpoonScoop", {"obs": "dict"}), ("DoseSpoon", {}))),
])
def test_each_environment_has_the_same_bits_as_alone(name: str, options: dict[str, Any]) -> None:
    """Where sums may be reordered, a branch that few grains take (a scooping one does) may round otherwise in one."""
    compare_exactly("test_vector", name, json.dumps(options))


def compared(name: str, written: str) -> None:
    """Observations, rewards and infos of three episodes side by side, over an end and into the next start."""
    options = json.loads(written)
    vector = make_vector(name, action_repeat=150, **options)
    alone = gymnasium.make(f"robosim/{name}-v0", disable_env_checker=True, action_repeat=150, **options)
    assert alone.spec is not None and alone.spec.max_episode_steps == vector.spec.max_episode_steps  # pyright: ignore[reportOptionalMemberAccess]
    seen, infos = vector.reset(seed=[5, 6, 7])
    together = [(seen, np.zeros(3), np.zeros(3, bool), np.zeros(3, bool), infos)]
    given = actions(vector, 1)
    steps = [next(given) for _ in range(9)]
    together += [vector.step(action) for action in steps]
    for e in range(3):
        observation, info = alone.reset(seed=5 + e)
        for k, (seen, rewards, ended, cut, infos) in enumerate(together):
            row: Any = {key: value[e] for key, value in seen.items()} if isinstance(seen, dict) else seen[e]
            if k == 0:
                assert same(row, observation) and same(of(infos, e), info)
                continue
            observation, reward, one_ended, one_cut, info = alone.step(steps[k - 1][e])
            assert (reward, one_ended, one_cut) == (rewards[e], ended[e], cut[e])
            mine = of(infos, e)
            if one_ended:
                assert same(mine.pop("final_obs"), observation) and same(mine.pop("final_info"), info)
                observation, info = alone.reset()
            assert same(row, observation) and same(mine, info)
    if name != "DoseSpoon":  # whose early ends test_dosing has
        assert sum(row[2].sum() for row in together) >= 3


@pytest.mark.long
def test_one_that_diverges_ends_alone(carried: gymnasium.vector.VectorEnv) -> None:
    """A particle of one is too fast: that episode ends with the reason and restarts; the others are unchanged."""
    batch = carried.batches[0]  # pyright: ignore[reportAttributeAccessIssue]
    given = actions(carried, 2)
    first, second = next(given), next(given)
    carried.reset(seed=3)
    expected = [carried.step(first), carried.step(second)]
    carried.reset(seed=3)
    carried.step(first)
    batch.batch.select(1)
    state = batch.world.solver.state()
    state["v"][4] = 1e30
    batch.batch.load(1, state)
    seen, rewards, ended, cut, infos = carried.step(second)
    assert ended.tolist() == [False, True, False] and not cut.any() and np.isfinite(seen).all()
    assert "speed nan" in infos["final_info"]["diverged"][1] and rewards[1] < -40
    for e in (0, 2):
        assert np.array_equal(seen[e], expected[1][0][e]) and rewards[e] == expected[1][1][e]
    assert np.isfinite(carried.step(first)[0]).all()


def each_mode(carried: gymnasium.vector.VectorEnv) -> Iterator[tuple[AutoresetMode, gymnasium.vector.VectorEnv]]:
    """A vector environment for each mode, one after the other: the first is that of SAME_STEP."""
    yield AutoresetMode.SAME_STEP, carried
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
        vector = make_vector("SpoonTranslate", action_repeat=150, autoreset_mode=mode.value)
        yield mode, vector
        vector.close()


@pytest.mark.slow
def test_all_modes_give_the_same_episodes(carried: gymnasium.vector.VectorEnv) -> None:
    """To the bit. One is reset after two steps, so that it ends later than the others, which begin anew meanwhile."""
    given = np.random.default_rng(1).uniform(-0.3, 0.3, (9, 3, 3)).astype(np.float32)
    late, episodes = np.array([False, True, False]), []
    for mode, vector in each_mode(carried):
        assert vector.metadata["autoreset_mode"] is mode
        rows = [vector.reset(seed=5)[0].copy()]

        def step(action: np.ndarray, vector: Any = vector, rows: list = rows) -> np.ndarray:
            """Step; keep what belongs to episodes that go on, and how others end."""
            seen, rewards, ended, cut, _ = vector.step(action)
            rows += [seen[~ended].copy(), rewards.copy(), ended.copy(), cut.copy()]
            return ended

        for action in given[:2]:
            step(action)
        rows.append(vector.reset(seed=9, options={"reset_mask": late})[0].copy())
        assert [step(action).sum() for action in given[2:7]] == [0, 0, 0, 0, 2]
        if mode is AutoresetMode.DISABLED:
            vector.reset(options={"reset_mask": ~late})
        for action in given[7:]:
            seen, rewards, ended, *_ = vector.step(action)
            rows += [rewards[1], ended[1]] if ended[1] else [seen[1].copy(), rewards[1]]
        assert ended[1]
        episodes.append(rows)
    assert same(episodes[0], episodes[1]) and same(episodes[0], episodes[2])


@pytest.mark.long
def test_an_environment_that_ended_waits_for_its_reset() -> None:
    """Nobody moves for a step that is refused."""
    vector = make_vector("SpoonTranslate", action_repeat=150, autoreset_mode="Disabled")
    still = np.zeros((3, 3), np.float32)
    vector.reset(seed=0)
    for _ in range(7):
        seen, _, ended, _, _ = vector.step(still)
    assert ended.all()
    vector.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(ConfigError, match="environments 1, 2 have ended; .*reset_mask"):
        vector.step(still)
    again, _ = vector.reset(options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(again[2], seen[2]) and again[0, -1] == 0.0
    with pytest.raises(ConfigError, match="environments 2 have ended"):
        vector.step(still)
    vector.close()
    with pytest.raises(UnknownName, match="autoreset_mode 'never'; valid: Disabled, NextStep, SameStep"):
        gymnasium.make_vec("robosim/SpoonTranslate-v0", num_envs=2, autoreset_mode="never")


@pytest.mark.long
def test_wrappers_of_gymnasium_work(carried: gymnasium.vector.VectorEnv) -> None:
    """RecordEpisodeStatistics in every mode; those that normalise, which need NEXT_STEP."""
    given = np.random.default_rng(1).uniform(-0.3, 0.3, (20, 3, 3)).astype(np.float32)
    for mode, vector in each_mode(carried):
        recorded = wrappers.RecordEpisodeStatistics(vector)
        recorded.reset(seed=5)
        total = np.sum([recorded.step(action)[1] for action in given[:7]], axis=0)
        assert recorded.episode_count == 3 and list(recorded.length_queue) == [7, 7, 7], mode
        assert np.array(recorded.return_queue) == pytest.approx(total)
    inner = make_vector("SpoonTranslate", action_repeat=150, autoreset_mode="NextStep")
    observed = wrappers.NormalizeObservation(inner)
    normalised = wrappers.NormalizeReward(observed)
    normalised.reset(seed=5)
    for action in given[:9]:
        seen, reward, *_ = normalised.step(action)
        assert np.isfinite(seen).all() and np.isfinite(reward).all()
    rows = [inner.reset(seed=5)[0], *(inner.step(action)[0] for action in given[:9])]
    every = np.concatenate(rows).astype(float)
    assert observed.obs_rms.mean == pytest.approx(every.mean(0), abs=1e-4)
    assert observed.obs_rms.var == pytest.approx(every.var(0), abs=1e-4)
    inner.close()


def test_wrong_input_is_refused(carried: gymnasium.vector.VectorEnv) -> None:
    good = next(actions(carried, 4))
    carried.reset(seed=0)
    expected = carried.step(good)[0]
    carried.reset(seed=0)
    bad = np.zeros((3, 3), np.float32)
    bad[2, 1] = np.nan
    for given, complaint in ((bad, r"action of environment 2\[1\] \(y\) = nan"), (bad[:2], r"accepted: \(3, 3\)")):
        with pytest.raises(ConfigError, match=complaint):
            carried.step(given)
    assert np.array_equal(carried.step(good)[0], expected)  # nobody has moved for what was refused
    with pytest.raises(UnknownName, match="nominal"):
        carried.reset(options={"start": 1})
    with pytest.raises(ConfigError, match=r"\[1\]; accepted: a dict of nominal"):
        carried.reset(options=[1])
    for options, complaint in (({"horizon": "terminated"}, "horizon"), ({"obs": "postions"}, "positions"),
                               ({"action_repeat": 2.5}, "whole number"), ({"material": "rice"}, "salt")):
        with pytest.raises(ConfigError, match=complaint):
            GrainVectorEnv("SpoonTranslate", 2, workers=1, **options)
    with pytest.raises(ConfigError, match="num_envs = 0"):
        gymnasium.make_vec("robosim/SpoonTranslate-v0", num_envs=0)


@pytest.mark.slow
def test_two_processes_give_the_same_and_report_a_dead_one() -> None:
    options: dict[str, Any] = {"action_repeat": 150}
    one, two = (GrainVectorEnv("SpoonTranslate", 3, workers=n, **options) for n in (1, 2))
    try:
        given = actions(one, 3)
        for vector in (one, two):
            vector.reset(seed=1)
        for _ in range(8):
            action = next(given)
            for a, b in zip(one.step(action), two.step(action)):
                assert same(a, b)
        with pytest.raises(ConfigError, match="environment 2"):
            two.step(np.array([[0, 0, 0], [0, 0, 0], [9, 0, 0]], np.float32))
        assert same(one.step(action), two.step(action))
        os.kill(two.batches[1].process.pid, 9)
        with pytest.raises(RobosimError, match="environments 2 to 2 ended with exit code -9"):
            two.step(action)
    finally:
        one.close()
        two.close()
    with pytest.raises(UnknownName, match="valid"):
        GrainVectorEnv("SpoonTranslate", 2, workers=2, material="rice")

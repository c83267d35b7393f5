"""Copies and states of vector environments, of tools alone and of arms: they continue to the bit like the original."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from grain_envs import make_vector, same
from gymnasium.vector import AutoresetMode
from test_copies import SHORT, SOFT, make

from robosim.base.errors import ConfigError

OF: dict[bool, dict[str, Any]] = {
    False: {"task": SHORT, "action_repeat": 80},
    True: {"task": SHORT.model_copy(update={"steps": 40}), "obs": "moments", "arm": True}}
"""Whether an arm carries the tool -> options; four actions are an episode."""
SLOW = pytest.mark.slow


def make_short(arm: bool, num_envs: int, workers: int | None = 1, mode: str = "SameStep", **options: Any) -> Any:
    """A vector environment whose episodes have four actions."""
    return make_vector("SpoonTranslate", num_envs, workers, autoreset_mode=mode, **OF[arm], **options)


@pytest.mark.long
@pytest.mark.parametrize(("arm", "num_envs", "workers"), [
    (False, 3, 1), pytest.param(False, 3, 2, marks=SLOW), pytest.param(True, 1, 1, marks=SLOW),
    pytest.param(True, 2, 1, marks=SLOW), pytest.param(True, 3, 2, marks=SLOW)])
def test_one_of_several_is_restored_alone(arm: bool, num_envs: int, workers: int) -> None:
    """To the bit, over ends of episodes, in this process or in others; a single environment continues it, too."""
    vector, last = make_short(arm, num_envs, workers, **SOFT), num_envs - 1
    actions = np.random.default_rng(0).uniform(-0.7, 0.7, (10, *vector.action_space.shape)).astype(np.float32)
    vector.reset(seed=3)
    states, results = [], []
    for action in actions:
        states.append([vector.state(e) for e in range(num_envs)])
        results.append(vector.step(action))
    assert sum(result[2].sum() for result in results) == 2 * num_envs

    vector.reset(seed=3)
    for k in range(4):
        vector.step(actions[k])
    others = [vector.state(e) for e in range(last)]
    vector.load(last, states[2][last])
    assert same([vector.state(e) for e in range(num_envs)], [*others, states[2][last]])
    for k in range(4, 10):  # the last one is two actions behind
        seen, rewards, terminated, _, _ = vector.step(np.stack([*actions[k][:last], actions[k - 2][last]]))
        for e in range(num_envs):
            j = k - 2 if e == last else k
            assert same((seen[e], rewards[e], terminated[e]), tuple(part[e] for part in results[j][:3]))
        assert k == 9 or same([vector.state(e) for e in range(num_envs)], [*states[k + 1][:last], states[k - 1][last]])

    before = vector.state(last)
    for wrong, message in (
            ({**before, "options": {**before["options"], "arm": not arm}}, f"arm = {not arm}; accepted: one"),
            ({key: value for key, value in before.items() if key != "counter"}, "it has no 'counter'"),
            ({**before, "episode": {**before["episode"], "running": False}}, "SAME_STEP"), ([], "load")):
        with pytest.raises(ConfigError, match=message):
            vector.load(last, wrong)
    for index in (num_envs, -1, 0.5):
        with pytest.raises(ConfigError, match=f"accepted: 0 to {last}"):
            vector.state(index)
    assert same(vector.state(last), before)

    vector.load(0, states[6][last])
    copied, expected = pickle.dumps(vector), (vector.step(actions[6]), vector.state(last))
    if workers > 1:
        twin = copy.deepcopy(vector)
        assert same((twin.step(actions[0]), twin.state(0)), (vector.step(actions[0]), vector.state(0)))
        twin.close()
    vector.close()
    with pytest.raises(ConfigError, match="closed"):
        vector.load(0, before)
    env, own = make("SpoonTranslate", **OF[arm], **SOFT)
    env.reset()
    own.load(states[1][last])
    assert same(own.state(), states[1][last])
    seen, reward, *_ = env.step(actions[1][last])
    alone = own.state()
    env.close()
    if arm:
        assert same((seen, reward, alone), (results[1][0][last], results[1][1][last], states[2][last]))
    assert reward == pytest.approx(results[1][1][last], abs=1e-3)  # the kernel of a batch sums in another order
    twin = pickle.loads(copied)
    assert same((twin.step(actions[6]), twin.state(last)), expected)
    twin.load(last, alone)
    assert same(twin.state(last), alone)
    twin.close()


@pytest.mark.long
@pytest.mark.parametrize("arm", [False, True])
def test_they_restart_in_every_mode(arm: bool) -> None:
    """The episodes are the same; with DISABLED an ended one waits for `reset` or for a state, also in a copy."""
    episodes = []
    for mode in ("SameStep", "NextStep", "Disabled"):
        vector = make_short(arm, 1, mode=mode)
        still = np.zeros(vector.action_space.shape, np.float32)
        with pytest.raises(ConfigError, match="call reset first"):
            vector.step(still)
        if mode == "Disabled":
            vector = replace(vector)  # one that never began
        started = vector.reset(seed=2)[0]
        running, steps = vector.state(0), [vector.step(still) for _ in range(4)]
        assert steps[-1][2].all() and vector.metadata["autoreset_mode"] is AutoresetMode(mode)
        last = steps[-1][4]["final_obs"][0] if mode == "SameStep" else steps[-1][0][0]
        following = steps[-1][0]
        if mode == "NextStep":
            following, reward, *over, _ = vector.step(still)
            assert reward == 0.0 and not np.any(over)
        if mode == "Disabled":
            vector = replace(vector)
            with pytest.raises(ConfigError, match="environments 0 have ended"):
                vector.step(still)
            following = vector.reset(options={"reset_mask": np.ones(1, bool)})[0]
        following = [following, *(vector.step(still)[0] for _ in range(3))]
        episodes.append([started, *(step[0] for step in steps[:3]), last, following])
        vector.load(0, running)
        assert same(vector.step(still)[:3], steps[0][:3])
        vector.close()
    assert same(episodes[0], episodes[1]) and same(episodes[0], episodes[2])


def replace(vector: Any) -> Any:
    """Close a vector environment and return its copy."""
    copied = pickle.dumps(vector)
    vector.close()
    return pickle.loads(copied)


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, pytest.param(None, marks=pytest.mark.slow)])
def test_arms_of_a_vector_are_called_by_name(workers: int | None) -> None:
    """Methods and attributes of each; what is refused leaves the vector environment as it was."""
    vector = make_short(True, 1 if workers else 2, workers)
    n = vector.num_envs
    vector.reset(seed=1)
    vector.step(np.zeros(vector.action_space.shape, np.float32))
    assert vector.get_attr("step_count") == (10,) * n and same(vector.call("state")[0], vector.state(0))
    vector.set_attr("camera", ["side"] * n)
    assert vector.get_attr("camera") == ("side",) * n
    with pytest.raises(ConfigError, match=r"name = 'step'; accepted: another method"):
        vector.call("step", np.zeros(3, np.float32))
    with pytest.raises(ConfigError, match=f"values has 5 entries; accepted: {n}"):
        vector.set_attr("camera", ["side"] * 5)
    with pytest.raises(AttributeError, match="no attribute 'colour'"):
        vector.get_attr("colour")
    if workers is None:  # fields stay in their process
        with pytest.raises(ConfigError, match=r"result of \('solver'.*cannot be pickled.*accepted: .* workers=1"):
            vector.get_attr("solver")
    assert vector.get_attr("step_count") == (10,) * n
    vector.close()


@pytest.mark.slow
def test_pictures_of_a_vector_show_the_state_of_each() -> None:
    """From processes of their own; a loaded state is drawn as it was, and the options of pictures may differ."""
    vector = make_vector("SpoonTranslate", 2, None, render_mode="rgb_array", camera="side", action_repeat=100)
    vector.reset(seed=0)
    state, first = vector.state(0), vector.render()
    vector.step(np.full((2, 3), 0.5, np.float32))
    vector.load(0, state)
    second = vector.render()
    assert vector.render_mode == "rgb_array" and vector.metadata["render_fps"] == 5
    assert same(first[0], second[0]) and not same(first[1], second[1]) and not same(first[0], first[1])
    vector.close()
    env, own = make("SpoonTranslate", action_repeat=100)
    own.load(state)
    assert same(own.state(), state)
    env.close()

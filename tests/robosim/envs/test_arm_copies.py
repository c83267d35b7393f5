"""Copies of environments with an arm, alone and in vector environments: they continue to the bit like the original."""

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from test_copies import SOFT, go_on, make, same

from robosim.base.errors import ConfigError
from robosim.tasks.task import load_task

SHORT = load_task("SpoonTranslate").model_copy(update={"steps": 40})
"""Four actions of ten steps are an episode."""


@pytest.mark.parametrize(("name", "options", "n"), [
    ("SpoonTranslate", {"obs": "moments", "task": SHORT}, 3),
    pytest.param("SpoonPour", {"grasp": "friction", **SOFT}, 30, marks=pytest.mark.slow),
])
def test_an_arm_continues_to_the_bit(name: str, options: dict[str, Any], n: int) -> None:
    """All that it keeps between steps, the ledger of the coupling included; a copy has built an arm of its own."""
    env, own = make(name, arm=True, **options)
    with pytest.raises(ConfigError, match=r"integration|state"):
        own.load({**own.state(), "carrier": {**own.state()["carrier"], "integration": np.zeros(3)}})
    env.reset(seed=3)
    go_on(env, n)
    state, copied = own.state(), pickle.dumps(env)
    first = go_on(env, n), own.state(), own.carrier.arm_readings
    assert any(wrench.any() for wrench in state["carrier"]["plugin"]["wrenches"])
    own.load(state)
    assert same(own.state(), state)
    assert same((go_on(env, n), own.state(), own.carrier.arm_readings), first)
    env.reset(seed=9)
    started = own.state()
    env.close()
    twin = pickle.loads(copied)
    assert same(twin.unwrapped.state(), state)
    assert same((go_on(twin, n), twin.unwrapped.state(), twin.unwrapped.carrier.arm_readings), first)
    twin.reset(seed=9)
    assert same(twin.unwrapped.state(), started)
    twin.close()


def make_arms(num_envs: int, workers: int | None, mode: str = "SameStep", **options: Any) -> Any:
    """Arms whose episodes have four actions of ten steps."""
    return gymnasium.make_vec("robosim/SpoonTranslate-v0", num_envs=num_envs, workers=workers, arm=True, task=SHORT,
                              autoreset_mode=mode, obs="moments", **options)


@pytest.mark.parametrize(("num_envs", "workers"), [
    (1, 1), pytest.param(2, 1, marks=pytest.mark.slow), pytest.param(3, 2, marks=pytest.mark.slow)])
def test_one_of_several_arms_is_restored_alone(num_envs: int, workers: int) -> None:
    """To the bit, over ends of episodes, in this process or in others; a single environment continues it, too."""
    vector, last = make_arms(num_envs, workers, **SOFT), num_envs - 1
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
    for wrong, message in (({**before, "options": {**before["options"], "arm": False}}, "arm = False; accepted: one"),
                           ({key: value for key, value in before.items() if key != "counter"}, "it has no 'counter'"),
                           ({**before, "episode": {**before["episode"], "running": False}}, "SAME_STEP"), ([], "load")):
        with pytest.raises(ConfigError, match=message):
            vector.load(last, wrong)
    with pytest.raises(ConfigError, match=f"index = {num_envs}; accepted: 0 to {last}"):
        vector.state(num_envs)
    assert same(vector.state(last), before)

    vector.load(0, states[6][last])
    copied, expected = pickle.dumps(vector), (vector.step(actions[6]), vector.state(last))
    if num_envs > 1:
        twin = copy.deepcopy(vector)
        assert same((twin.step(actions[0]), twin.state(0)), (vector.step(actions[0]), vector.state(0)))
        twin.close()
    vector.close()
    with pytest.raises(ConfigError, match="closed"):
        vector.load(0, before)
    twin = pickle.loads(copied)
    assert same((twin.step(actions[6]), twin.state(last)), expected)
    twin.close()
    env, own = make("SpoonTranslate", arm=True, task=SHORT, obs="moments", **SOFT)
    env.reset()
    own.load(states[1][last])
    seen, reward, *_ = env.step(actions[1][last])
    assert same((seen, reward), (results[1][0][last], results[1][1][last]))
    assert same(own.state(), states[2][last])
    env.close()


def test_arms_restart_in_every_mode() -> None:
    """The episodes are the same; with DISABLED an ended arm waits for `reset` or for a state, also in a copy."""
    still, episodes = np.zeros((1, 3), np.float32), []
    for mode in ("SameStep", "NextStep", "Disabled"):
        vector = make_arms(1, 1, mode)
        with pytest.raises(ConfigError, match="call reset first"):
            vector.step(still)
        started = vector.reset(seed=2)[0]
        running, steps = vector.state(0), [vector.step(still) for _ in range(4)]
        assert steps[-1][2].all() and vector.metadata["autoreset_mode"] is AutoresetMode(mode)
        last = steps[-1][4]["final_obs"][0] if mode == "SameStep" else steps[-1][0][0]
        following = steps[-1][0]
        if mode == "NextStep":
            following, reward, *over, _ = vector.step(still)
            assert reward == 0.0 and not np.any(over)
        if mode == "Disabled":
            copied = pickle.dumps(vector)
            vector.close()
            vector = pickle.loads(copied)
            with pytest.raises(ConfigError, match="environments 0 have ended"):
                vector.step(still)
            following = vector.reset(options={"reset_mask": np.ones(1, bool)})[0]
        following = [following, *(vector.step(still)[0] for _ in range(3))]
        episodes.append([started, *(step[0] for step in steps[:3]), last, following])
        vector.load(0, running)
        assert same(vector.step(still)[:3], steps[0][:3])
        vector.close()
    assert same(episodes[0], episodes[1]) and same(episodes[0], episodes[2])


@pytest.mark.parametrize("workers", [1, pytest.param(None, marks=pytest.mark.slow)])
def test_arms_of_a_vector_are_called_by_name(workers: int | None) -> None:
    """Methods and attributes of each; what is refused leaves the vector environment as it was."""
    vector = make_arms(1 if workers else 2, workers)
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


def test_a_state_moves_from_arm_to_arm() -> None:
    """It changes the arm that takes it, and neither the one that it is of nor itself."""
    vector = make_arms(2, 1)
    vector.reset(seed=1)
    first, second = vector.state(0), vector.state(1)
    given = copy.deepcopy(first)
    assert not same(first, second)
    vector.load(1, given)
    assert same((vector.state(0), vector.state(1), given), (first, first, first))
    vector.load(1, second)
    assert same((vector.state(0), vector.state(1)), (first, second))
    vector.close()


@pytest.mark.slow
def test_pictures_of_a_vector_show_the_state_of_each() -> None:
    """From processes of their own; a loaded state is drawn as it was, and the options of pictures may differ."""
    vector: Any = gymnasium.make_vec("robosim/SpoonTranslate-v0", num_envs=2, render_mode="rgb_array", camera="side",
                                     action_repeat=100)
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

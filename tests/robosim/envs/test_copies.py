"""Copies of environments: a state that was saved, loaded, copied or pickled continues to the bit like the original.

To compile a scene takes seconds. So the quick tests share one sub-task, close what they have made, and advance a copy
only once its original is closed and has left it the compiled fields."""

import copy
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from grain_envs import same

from robosim.base.errors import ConfigError
from robosim.tasks.task import load_task

SHORT = load_task("SpoonTranslate").model_copy(update={"steps": 320})
"""Its grains settle once for the quick tests."""
SOFT: dict[str, Any] = {"randomize": {"friction_angle_deg": (20.0, 40.0), "density": (1000.0, 1200.0)}}


def make(name: str, **options: Any) -> tuple[gymnasium.Env, Any]:
    """An environment, and the same without wrappers."""
    env = gymnasium.make(f"robosim/{name}-v0", disable_env_checker=True, **options)
    return env, env.unwrapped


def go_on(env: gymnasium.Env, steps: int, seed: int = 1) -> list[Any]:
    """Results of random steps, over the ends of episodes and into the next starts."""
    rng, results = np.random.default_rng(seed), []
    for _ in range(steps):
        action = rng.uniform(-0.6, 0.6, env.action_space.shape)
        results.append(env.step(action.astype(np.float32)))
        if results[-1][2] or results[-1][3]:
            results.append(env.reset())
    return results


@pytest.mark.long
@pytest.mark.parametrize(("name", "options"), [
    ("SpoonTranslate", {"task": SHORT, "obs": "dict", "horizon": "truncate", **SOFT}),
    ("SpoonPour", {"obs": ["tool", "scale", {"name": "wrist", "rate": 30.0}], "randomize": "wide", "latency": 0.04,
                   "noise": 0.01, "dropout": 0.2, "action_delay": 0.03}),
    pytest.param("SpoonPour", {"obs": "moments", "horizon": "truncate"}, marks=pytest.mark.slow),
    pytest.param("ShovelMove", {"obs": "none", "clip_actions": True}, marks=pytest.mark.slow),
    pytest.param("SpoonScoop", {"obs": "moments", **SOFT}, marks=pytest.mark.slow),
    pytest.param("BottlePickPour", {"material": "water"}, marks=pytest.mark.slow),
    pytest.param("DoseSpoon", {}, marks=pytest.mark.slow),  # in the middle of a vibration
])
def test_a_loaded_state_continues_to_the_bit(name: str, options: dict[str, Any]) -> None:
    """Over the end of the episode and into the next, drawn start; a carrying spoon is saved once it has lost grains."""
    env, own = make(name, action_repeat=128, **options)
    env.reset(seed=4)
    jerks = np.zeros((2, *own.actions.space.shape), np.float32)
    jerks[:, :3] = [[1.0, 1.0, 0.8], [-1.0, -1.0, -1.0]]
    for jerk in jerks:
        env.step(jerk)
    assert own.episode.counts.exited or name not in ("SpoonTranslate", "SpoonPour") or "latency" in options
    state, stored = own.state(), pickle.dumps(own.state())
    left = own.max_episode_steps - own.step_count // 128
    first = go_on(env, left + 1)
    assert any(result[-1]["time"] == 0.0 for result in first)
    own.load(state)
    assert same(own.state(), state)
    assert same(go_on(env, left + 1), first)
    own.load(pickle.loads(stored))
    assert same(own.state(), state)
    env.close()


@pytest.mark.long
@pytest.mark.parametrize(("name", "options", "n"), [
    ("SpoonTranslate", {"obs": "moments", "task": SHORT.model_copy(update={"steps": 40})}, 3),
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


@pytest.mark.long
def test_a_copy_and_its_original_go_their_own_ways() -> None:
    """Both continue equally, wrappers included, and neither moves the other; spaces draw on as the original's do."""
    env, own = make("SpoonTranslate", task=SHORT, **SOFT)
    env = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.wrappers.TimeLimit(env, 30))
    env.reset(seed=2)
    env.action_space.seed(5)
    copied: Any = copy.deepcopy(env)
    before = copied.unwrapped.state()
    assert same(own.state(), before)
    results = go_on(env, 32)
    assert same(copied.unwrapped.state(), before)  # an original does not move its copy
    after, sample = own.state(), env.action_space.sample()
    env.close()
    twin: Any = copy.deepcopy(copied)
    again = go_on(twin, 32)
    assert same(copied.unwrapped.state(), before)  # and a copy does not move its original
    for result in results + again:  # the wrapper's clock
        result[-1].get("episode", {}).pop("t", None)
    assert same(again, results) and any(result[-1].get("episode") for result in again)
    assert same(twin.unwrapped.state(), after)
    assert same(twin.action_space.sample(), sample) and twin.spec is not None
    copied.close()
    twin.close()  # the last, so that the next test takes the fields that have kernels


OTHER_PROCESS = """import pickle, sys
import test_copies
env = pickle.load(open(sys.argv[1], "rb"))
pickle.dump(test_copies.go_on(env, 4), open(sys.argv[2], "wb"))
"""


@pytest.mark.slow
def test_a_pickled_environment_continues_in_another_process(tmp_path: Path) -> None:
    """With the arguments of `mpm.init` of this one."""
    env, _ = make("SpoonTranslate", obs="moments")
    env.reset(seed=6)
    go_on(env, 2)
    (tmp_path / "env").write_bytes(pickle.dumps(env))
    expected = go_on(env, 4)
    subprocess.run([sys.executable, "-c", OTHER_PROCESS, str(tmp_path / "env"), str(tmp_path / "results")],
                   env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}, check=True, timeout=900)
    assert same(pickle.loads((tmp_path / "results").read_bytes()), expected)
    env.close()


@pytest.mark.long
def test_an_environment_that_never_began_has_copies() -> None:
    env, own = make("SpoonTranslate", task=SHORT, obs="none")
    twin = pickle.loads(pickle.dumps(env))
    assert same(twin.unwrapped.state(), own.state())
    assert same(twin.reset(seed=1), env.reset(seed=1))
    twin.close()
    env.close()


def test_what_is_no_state_of_this_environment_changes_nothing() -> None:
    others: list[Any] = []
    for options in ({"action_repeat": 5}, {"task": SHORT.model_copy(update={"description": "carry it"})}):
        one = make("SpoonTranslate", **{"task": SHORT, **options})[1]
        others.append(one.state())
        one.close()
    other, another = others
    env, own = make("SpoonTranslate", task=SHORT)
    env.reset(seed=1)
    state = own.state()
    go_on(env, 2)
    before = own.state()
    short = {**state, "solver": {**state["solver"], "x": state["solver"]["x"][1:]}}
    for wrong, message in (
            (other, "action_repeat = 5; accepted: one with action_repeat = 10"),
            (another, "task.description = 'carry it'; accepted: one with"),
            ([], r"\[\]; accepted: what `state`"), (short, "x has shape"),
            ({key: value for key, value in state.items() if key != "counter"}, "it has no 'counter'"),
            ({**state, "carrier": {"commanded": np.zeros(3)}}, "pose has shape"),
            ({**state, "material": {**state["material"], "E": -1.0}}, "E")):
        with pytest.raises(ConfigError, match=message):
            own.load(wrong)  # pyright: ignore[reportArgumentType]
        assert same(own.state(), before)
    env.close()
    for ask in (own.state, lambda: own.load(state), lambda: copy.deepcopy(env)):
        with pytest.raises(ConfigError, match="closed"):
            ask()

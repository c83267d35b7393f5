"""Copies of environments: a state that was saved, loaded, copied or pickled continues to the bit like the original.

To compile a scene takes seconds. So the quick tests share one sub-task, close what they have made, and advance a copy
only once its original is closed and has left it the compiled fields.
"""

import copy
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import robosim  # noqa: F401  (registers the environments)
from robosim.base.errors import ConfigError
from robosim.envs.grain_env import GrainEnv
from robosim.tasks.task import load_task

SHORT = load_task("SpoonTranslate").model_copy(update={"steps": 320})
"""Its grains settle once for the quick tests."""
SOFT: dict[str, Any] = {"randomize": {"friction_angle_deg": (20.0, 40.0), "density": (1000.0, 1200.0)}}


def same(one: Any, other: Any) -> bool:
    """Whether two results hold the same bits."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray) and not one.dtype.hasobject:
        return one.dtype == other.dtype and one.tobytes() == other.tobytes()
    return same(list(one), list(other)) if isinstance(one, np.ndarray) else one == other


def make(name: str, **options: Any) -> tuple[gymnasium.Env, GrainEnv]:
    env = gymnasium.make(f"robosim/{name}-v0", disable_env_checker=True, **options)
    assert isinstance(env.unwrapped, GrainEnv)
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


@pytest.mark.parametrize(("name", "options"), [
    ("SpoonTranslate", {"task": SHORT, "obs": "dict", "horizon": "truncate", **SOFT}),
    pytest.param("SpoonPour", {"obs": "moments", "horizon": "truncate"}, marks=pytest.mark.slow),
    pytest.param("ShovelMove", {"obs": "none", "clip_actions": True}, marks=pytest.mark.slow),
    pytest.param("SpoonScoop", {"obs": "moments", **SOFT}, marks=pytest.mark.slow),
    pytest.param("BottlePickPour", {"material": "water"}, marks=pytest.mark.slow),
])
def test_a_loaded_state_continues_to_the_bit(name: str, options: dict[str, Any]) -> None:
    """Over the end of the episode and into the next, drawn start; a carrying spoon is saved once it has lost grains."""
    env, own = make(name, action_repeat=128, **options)
    env.reset(seed=4)
    jerks = np.zeros((2, *own.actions.space.shape), np.float32)
    jerks[:, :3] = [[1.0, 0.0, 0.8], [-1.0, 0.0, -1.0]]
    for jerk in jerks:
        env.step(jerk)
    assert own.episode.counts.exited or name not in ("SpoonTranslate", "SpoonPour")
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
    """With the arguments of `mpm.init` of this one.

    Quick tests cover both halves: a pickled environment continues in this process, and a forked process gives the bits
    of this one.
    """
    env, _ = make("SpoonTranslate", obs="moments")
    env.reset(seed=6)
    go_on(env, 2)
    (tmp_path / "env").write_bytes(pickle.dumps(env))
    expected = go_on(env, 4)
    subprocess.run([sys.executable, "-c", OTHER_PROCESS, str(tmp_path / "env"), str(tmp_path / "results")],
                   cwd=Path(__file__).parent, check=True, timeout=900)
    assert same(pickle.loads((tmp_path / "results").read_bytes()), expected)
    env.close()


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


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_one_of_a_vector_is_restored_alone(workers: int) -> None:
    """To the bit, and the others go on; what moves to a single environment and back is the same state."""
    vector: Any = gymnasium.make_vec("robosim/SpoonTranslate-v0", num_envs=3, workers=workers, action_repeat=64,
                                     task=SHORT, **SOFT)
    vector.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-0.7, 0.7, (11, *vector.action_space.shape)).astype(np.float32)
    states, results = [], []
    for action in actions:
        states.append([vector.state(e) for e in range(3)])
        results.append(vector.step(action))
    others = vector.state(0), vector.state(2)
    vector.load(1, states[2][1])
    assert same((vector.state(0), vector.state(2)), others)
    assert same(vector.state(1), states[2][1])
    vector.load(0, states[4][2])
    ended = 0
    for k in range(2, 9):
        seen, rewards, over, _, _ = vector.step(np.stack([actions[k + 2][2], actions[k][1], actions[k][2]]))
        for e, (j, of) in enumerate(((k + 2, 2), (k, 1))):
            assert same(seen[e], results[j][0][of]) and rewards[e] == results[j][1][of]
        ended += over[:2].sum()
    assert ended >= 2
    copied, expected = pickle.dumps(vector), vector.step(actions[0])
    vector.close()
    with pytest.raises(ConfigError, match="closed"):
        vector.state(0)
    env, own = make("SpoonTranslate", action_repeat=64, task=SHORT, **SOFT)
    env.reset()
    own.load(states[7][0])
    assert same(own.state(), states[7][0])
    assert env.step(actions[7][0])[1] == pytest.approx(results[7][1][0], abs=1e-3)
    running = own.state()
    while own.episode.running:
        env.step(actions[0][0])
    over = own.state()
    env.close()
    twin = pickle.loads(copied)
    if workers > 1:
        other = copy.deepcopy(twin)
        assert same(other.step(actions[0]), expected)
        other.close()
    assert same(twin.step(actions[0]), expected)
    twin.load(2, running)
    assert same(twin.state(2), running)
    with pytest.raises(ConfigError, match="SAME_STEP"):
        twin.load(0, over)
    for index in (3, -1, 0.5):
        with pytest.raises(ConfigError, match="accepted: 0 to 2"):
            twin.state(index)
    twin.close()


def test_a_vector_that_waits_for_a_reset_waits_in_its_copy() -> None:
    """With DISABLED, an ended environment is saved as ended, and a state of a running one revives it."""
    vector: Any = gymnasium.make_vec("robosim/SpoonTranslate-v0", num_envs=3, workers=1, action_repeat=160,
                                     autoreset_mode="Disabled", task=SHORT)
    copied, started = pickle.dumps(vector), vector.reset(seed=1)
    vector.close()
    vector = pickle.loads(copied)  # of one that never began
    assert same(vector.reset(seed=1), started)
    running, still = vector.state(0), np.zeros(vector.action_space.shape, np.float32)
    vector.step(still)
    vector.step(still)
    copied, results = pickle.dumps(vector), []
    for _ in range(2):
        with pytest.raises(ConfigError, match="environments 0, 1, 2 have ended"):
            vector.step(still)
        for e in range(3):
            vector.load(e, running)
        results.append(vector.step(still))
        vector.close()
        vector = pickle.loads(copied)
    assert same(*results)
    vector.close()

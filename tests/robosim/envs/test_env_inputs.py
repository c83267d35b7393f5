"""Wrong input to the environments is refused with what is accepted; options have their effect."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from grain_envs import make, make_vector, play

import mpm
import robosim
from robosim.base.digests import cache_folder
from robosim.config.materials import load_material, overridden
from robosim.envs.grain_env import GrainEnv
from robosim.studies.policies.make import make_policy
from robosim.tasks.task import load_task


@pytest.fixture(scope="module")
def env() -> GrainEnv:
    return make("ShovelMove", randomize={"friction_angle_deg": (20.0, 40.0), "E": (1e5, 2e5)})


@pytest.mark.parametrize(("options", "words"), [
    ({"material": "pepper"}, ("'pepper'", "clay, flour", "water")), ({"obs": "pixels"}, ("'pixels'", "moments")),
    ({"horizon": "never"}, ("'never'", "terminate, truncate")), ({"action_repeat": 0}, ("action_repeat = 0", "from 1")),
    ({"colour": 3.0}, ("'colour'", "E, cohesion, density")), ({"render_mode": "ascii"}, ("'ascii'", "rgb_array")),
    ({"randomize": {"E": (2e5, 1e5)}}, ("E = (200000.0, 100000.0)", "(lowest, highest)")),
    ({"grasp": "glue", "obs": "none"}, ("'glue'", "friction, weld")),
    ({"material": 5}, ("unknown material 5; valid: clay", "or the path of a .yaml file of your own")),
])
def test_unknown_options_list_the_valid_ones(options: dict, words: tuple[str, ...]) -> None:
    with pytest.raises(robosim.RobosimError) as caught:
        GrainEnv(task="ShovelMove", **options)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.long
def test_a_closed_environment_says_so() -> None:
    """Alone and among others, whatever is called; closing it twice is accepted.

    It comes before those that use `env`, whose fields and kernels are those that it leaves."""
    env, vector = make("ShovelMove", render_mode="rgb_array"), make_vector("ShovelMove", 2)
    for one in (env, env, vector, vector):
        one.close()
    for method, call in (("step", lambda: env.step(np.zeros(3, np.float32))), ("reset", env.reset),
                         ("render", env.render), ("rollout", env.rollout), ("reset", vector.reset),
                         ("step", lambda: vector.step(np.zeros((2, 3), np.float32)))):
        with pytest.raises(robosim.ConfigError, match=f"{method}: the environment is closed; make a new one"):
            call()


def test_actions_are_checked(env: GrainEnv) -> None:
    env.reset(seed=0)
    for action, words in (
        (np.zeros(6, np.float32), r"shape \(6,\); accepted: \(3,\)"), (np.zeros(3, int), "dtype int64"),
        (np.array([0, np.nan, 0]), r"action\[1\] \(y\) = nan"), (np.array([0, 0, 1.5]), r"action\[2\] \(z\) = 1.5"),
        (np.full(3, 0.1 + 0.2j), "dtype complex128; accepted: floating-point numbers"),
    ):
        with pytest.raises(robosim.ConfigError, match=words):
            env.step(action)
    env.actions.clip = True
    env.step(np.array([0.0, 0.0, 1.5]))
    with pytest.raises(robosim.ConfigError, match="nan"):
        env.step(np.array([0, np.nan, 0]))
    env.actions.clip = False
    with pytest.raises(robosim.UnknownName, match="nominal"):
        env.reset(options={"easy": True})
    for options, words in (([1], r"\[1\]; accepted: a dict"), ({"nominal": "no"}, "'no'; accepted: True")):
        with pytest.raises(robosim.ConfigError, match=words):
            env.reset(options=options)


def test_random_materials_reach_the_field(env: GrainEnv) -> None:
    parameters = []
    for seed in range(4):
        env.reset(seed=seed)
        parameters.append(env.solver.fields.parameters.law.to_numpy()[0].copy())
    assert len({tuple(row) for row in parameters}) == 4
    with pytest.raises(mpm.InvalidValue, match="DruckerPrager"):
        env.solver.set_material(0, mpm.VonMises(E=1e5, nu=0.2, density=1200.0, yield_stress=1e3))


def test_a_registered_name_refuses_another_kind_of_task() -> None:
    with pytest.raises(robosim.ConfigError, match="poured with the scoop; accepted for .*Pour-v0: .*the spoon"):
        gymnasium.make("robosim/SpoonPour-v0", task="ScoopPour")


@pytest.mark.slow
def test_a_corrupt_start_is_rebuilt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                    capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setenv("ROBOSIM_CACHE", str(tmp_path))
    make("ShovelMove").reset(seed=0)
    (path,) = cache_folder("starts").glob("ShovelMove-*.npz")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    capsys.readouterr()
    first = make("ShovelMove").reset(seed=0)[0]
    assert "corrupt; rebuilding" in capsys.readouterr().err
    assert path.stat().st_size == pytest.approx(len(whole), rel=0.01)
    second = make("ShovelMove").reset(seed=0)[0]
    assert capsys.readouterr().err == "" and np.array_equal(first, second)


def test_numbers_of_a_material_can_be_given() -> None:
    changed = overridden(load_material("salt"), {"E": 2e5, "friction_angle_deg": 25.0})
    law = changed.make_law()
    assert isinstance(law, mpm.DruckerPrager) and law.E == 2e5 and law.friction_angle_deg == 25.0
    assert load_material("water").numbers() == ["density", "bulk_modulus", "viscosity"]
    with pytest.raises(robosim.UnknownName, match="bulk_modulus, density, viscosity"):
        overridden(load_material("water"), {"E": 1.0})


def test_a_recorded_episode_replays_to_the_same_score(env: GrainEnv, tmp_path: Path) -> None:
    path, actions = tmp_path / "actions.npz", []
    act = make_policy("scripted", env, 2)
    total = play(env, lambda seen: actions.append(act(seen)) or actions[-1], seed=2)[0]
    np.savez(path, actions=actions)
    assert play(env, str(path), seed=2)[0] == total
    np.savez(path, actions=np.zeros((4, 6)))
    with pytest.raises(robosim.ConfigError, match=r"\(4, 6\); accepted: \(n, 3\)"):
        make_policy(str(path), env, 0)
    with pytest.raises(robosim.UnknownName, match="pi, random, recorded, scripted, shaker, zero"):
        make_policy("clever", env, 0)


@pytest.mark.long
@pytest.mark.parametrize(("task", "arm"), [("SpoonPour", False),
                                           pytest.param("SpoonTranslate", True, marks=pytest.mark.slow)])
def test_a_stiffer_material_gets_a_smaller_step(task: str, arm: bool) -> None:
    """Paper is too stiff for a step that the sub-task's file asks for, so that its solver chooses a smaller one.

    With an arm, the plugin would refuse one that is requested and does not divide its own step."""
    own = load_task(task)
    asking = own.model_copy(update={"field": own.field.model_copy(update={"dt": 0.0004})})
    env = make(task, task=asking, material="paper", arm=arm)
    assert arm or asking.field.dt > env.solver.bound > env.solver.dt
    env.reset(seed=0)
    *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
    assert np.isfinite(info["tcs"]) and not info.get("diverged") and info["readings"]["retained"] > 0.9

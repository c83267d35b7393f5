"""Methods, from preset to finished run."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from docstring_example import run_example
from stable_baselines3 import TD3
from stable_baselines3.common.noise import NormalActionNoise

from policies.demonstrations.spline_search import sample_spline
from policies.learners.learner import NOISE
from policies.learning.environments import make_environment
from policies.learning.options import TrainingOptions
from policies.learning.presets import load_preset
from policies.methods import method as registry
from policies.methods.train import train
from policies.runs import checkpoint
from policies.runs.episodes import Episodes
from policies.runs.training import Training
from robosim.base.resources import config_names
from robosim.config.settings import Setting
from robosim.episode.play import play
from robosim.studies.policies.make import make_policy, training_options

SMALL = {"learning_rate": 1e-3, "batch_size": 32, "learning_starts": 0, "policy_kwargs": {"net_arch": [32, 32]}}
EPISODES = {"demo": 1}  # episodes of a short run: the one demonstration; 3 of other methods


def test_a_run_is_the_method_itself(tmp_path):
    """The same parameters, bit for bit, as Stable-Baselines3's own class in the same episodes; SAC has updates of its
    own, which test_soft_actor_critic.py compares."""
    preset = load_preset("td3").model_copy(update={"episodes": 2, "options": SMALL})
    training = Training("td3", preset, "Pendulum-v1", tmp_path, TrainingOptions(seed=0))
    training.learn()
    own = TD3("MlpPolicy", Episodes(gymnasium.make("Pendulum-v1"), 0, None, lambda episode: None), seed=0,
              action_noise=NormalActionNoise(np.zeros(1), np.full(1, NOISE)), device="cpu",
              **SMALL).learn(399)  # a run ends before the update after its last step
    for one, other in zip(training.model.policy.parameters(), own.policy.parameters(), strict=True):
        assert torch.equal(one, other)


def test_the_example_of_a_method_runs_and_continues(tmp_path, monkeypatch):
    """An interrupted run ends with the episodes of one that was not; the code is the docstring's."""
    names = {"np": np, "checkpoint": checkpoint, "sample_spline": sample_spline, "play": play, "Training": Training}
    example = run_example(registry.Method, "Example, a random search:", names)["search_randomly"]
    monkeypatch.setattr(registry, "METHODS", {**registry.METHODS, "replay": example})
    returns = {}
    for name, episodes in (("whole", [4]), ("interrupted", [2, 4])):
        for last in episodes:
            preset = load_preset("demo").model_copy(update={"episodes": 4, "learner": "GNN-CMA-ES", "options": {
                "knots": 4}})
            training = Training(name, preset, "Pendulum-v1", tmp_path / name, TrainingOptions(seed=1))
            training.preset = preset.model_copy(update={"episodes": last})
            registry.select_method("replay")(training)
            training.folder.close()
        returns[name] = [row["return"] for row in training.folder.rows]
    assert len(returns["whole"]) == 4 and returns["whole"] == returns["interrupted"]


@pytest.mark.long
def test_a_correction_of_the_knowing_script_begins_as_the_script_and_stays_near_it(tmp_path):
    """Also from its file; and from random starts nothing draws the actor to its best episode."""
    changes = {"expert": "knowing", "obs": "goal_frame,pending,time", "episodes": 1, "actor.imitation": 0.5}
    preset = load_preset("residual", [Setting(tuple(key.split(".")), value) for key, value in changes.items()])
    (ranges := tmp_path / "ranges.yaml").write_text("place_x: [-0.1, 0.1]")
    training = Training("residual", preset, "SpoonTranslate", tmp_path / "run", TrainingOptions(randomize=str(ranges)))
    training.learn()
    assert training.model.best is None
    file, away = tmp_path / "run" / "best_policy.npz", tmp_path / "away.npz"
    stored: Any = dict(np.load(file))
    np.savez(away, **stored | {f"bias_{len(stored['activations']) - 1}": np.full(3, 9.0, np.float32)})
    env: Any = make_environment("SpoonTranslate", randomize=str(ranges), **training_options(str(file))).unwrapped
    env.reset(seed=5)
    script, corrected, far = (make_policy(str(name), env, 0) for name in ("knowing", file, away))
    for _ in range(5):
        action = script(None)
        assert corrected(env.observation) == pytest.approx(action, abs=1e-6)
        assert far(env.observation) == pytest.approx(np.clip(action + preset.residual, -1, 1), abs=1e-6)
        env.step(action)


@pytest.mark.slow
def test_soft_actor_critic_learns_the_pendulum(tmp_path):
    """20 000 steps at a rate of 1e-3: the mean of 100 episodes lies within -200 and -120."""
    preset = load_preset("sac").model_copy(update={"episodes": 100})
    preset = preset.model_copy(update={"options": {**preset.options, "learning_rate": 1e-3, "batch_size": 256}})
    training = Training("sac", preset, "Pendulum-v1", tmp_path, TrainingOptions(seed=0))
    training.learn()
    env = gymnasium.make("Pendulum-v1")
    totals = [play(env, lambda observation: training.model.predict(observation, deterministic=True)[0],
                   seed=1000 + k)[0] for k in range(100)]
    assert -200 < np.mean(totals) < -120


@pytest.mark.slow
@pytest.mark.parametrize("method", [name for name in config_names("training") if not load_preset(name).needs_rollouts
                                    and load_preset(name).expert is None])
def test_every_method_runs_on_grains(tmp_path, method):
    """A few episodes; the stored motion gives the return that was trained with, and is the method's own."""
    rng = np.random.default_rng(0)
    demonstration = rng.uniform(-0.3, 0.3, (50, 3)).astype(np.float32)
    np.savez(tmp_path / "demonstration_0.npz", actions=demonstration, action_repeat=20)
    preset, out, episodes = load_preset(method), tmp_path / "run", EPISODES.get(method, 3)
    options = TrainingOptions(demos=tmp_path if preset.needs_demonstrations else None, action_repeat=20)
    assert train(method, "SpoonTranslate", out, options, episodes=episodes) == 0
    status = json.loads((out / "status.json").read_text())
    assert status["state"] == "finished" and status["episodes"] == episodes
    assert status["replayed"]["return"] == pytest.approx(status["best_return"], abs=1e-9)
    best = np.load(out / "best.npz")
    assert best["action_repeat"] == 20 and best["actions"].shape == (50, 3)
    if method == "demo":
        assert np.array_equal(best["actions"], demonstration)
    if preset.residual is not None:
        assert np.abs(best["actions"] - demonstration).max() <= preset.residual + 1e-6
    has_policy_file = preset.residual is None and preset.encoder is None and preset.learner in (
        "BC", "DAgger", "GAIL", "PPO", "SAC", "TD3", "DDPG")
    assert (out / "best_policy.npz").is_file() == has_policy_file
    if has_policy_file:
        check_policy_file(out, best, is_deterministic=preset.learner == "BC")


def check_policy_file(out: Path, best, is_deterministic: bool) -> None:
    """The file acts in an environment made with its options; a policy without noise makes the best motion again."""
    options = training_options(str(out / "best_policy.npz"))
    env = gymnasium.make("robosim:robosim/SpoonTranslate-v0", **options).unwrapped
    observation = env.reset(seed=int(best["start"]), options={"nominal": True})[0]
    assert np.load(out / "best_policy.npz")["weight_0"].shape[1] == len(observation)
    act = make_policy(str(out / "best_policy.npz"), env, 0)
    for action in best["actions"][:5]:
        own = act(env.observation)
        assert own.shape == (3,) and np.all(np.abs(own) <= 1.0) and own.any()
        if is_deterministic:
            assert own == pytest.approx(action, abs=1e-5)
        env.step(action)  # so that the policy sees the states of the motion

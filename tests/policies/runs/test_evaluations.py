"""Evaluations of a run's deterministic policy: they change nothing of the run, and judge by what they see."""

import csv

import numpy as np
import pytest
import torch

import mpm
from policies.learning.environments import make_training_environment
from policies.learning.options import TrainingOptions
from policies.learning.presets import load_preset
from policies.runs.evaluations import PATIENCE, Evaluations, SaturatedActor
from policies.runs.training import Training
from robosim.episode.play import run_episode

pytestmark = pytest.mark.filterwarnings("ignore::mpm.GrainsLeaveGrid")  # of a policy that has learned nothing yet
REPEAT = 100  # steps of an action: ten decisions an episode
OPTIONS = {"learning_rate": 1e-3, "batch_size": 16, "learning_starts": 5, "policy_kwargs": {"net_arch": [16, 16]}}


def run(folder, *, episodes=4, starts="random", **settings):
    preset = load_preset("sac").model_copy(update={"episodes": episodes, "options": OPTIONS, "obs": "none"})
    training = Training("x", preset, "SpoonTranslate", folder,
                        TrainingOptions(action_repeat=REPEAT, starts=starts, **settings))
    training.learn()
    training.finish()
    training.folder.close()
    return training


@pytest.mark.slow
def test_a_run_is_the_same_however_often_its_policy_is_evaluated(tmp_path):
    often, once = run(tmp_path / "often", evaluate_every=1), run(tmp_path / "once", evaluate_every=100)
    keys = ("episode", "start", "return", "tcs", "decisions")
    assert [[row[key] for key in keys] for row in often.folder.rows] == [
        [row[key] for key in keys] for row in once.folder.rows]
    weights = [run.model.policy.parameters() for run in (often, once)]
    assert all(torch.equal(*pair) for pair in zip(*weights, strict=True))
    assert [row["episode"] for row in often.evaluations.rows] == [1, 2, 3, 4]
    assert [row["episode"] for row in once.evaluations.rows] == [4]
    last, again = (dict(training.evaluations.rows[-1], seconds=0) for training in (often, once))
    assert last == again and last["episodes"] == 5
    assert len(list(csv.DictReader((tmp_path / "often" / "evaluations.csv").read_text().splitlines()))) == 4
    best = max(often.evaluations.rows, key=lambda row: (row["tcs"], row["return"]))
    assert often.folder.read_json("status.json")["evaluated"]["best"] == best
    assert (tmp_path / "often" / "best_policy.npz").is_file()


@pytest.mark.slow
def test_a_resumed_run_has_the_evaluations_of_a_whole_one(tmp_path):
    whole = run(tmp_path / "whole", evaluate_every=2, checkpoint_every=1, starts="nominal")
    part = run(tmp_path / "part", episodes=3, evaluate_every=2, checkpoint_every=1, starts="nominal")
    assert [row["episode"] for row in part.evaluations.rows] == [2, 3]
    again = run(tmp_path / "part", evaluate_every=2, checkpoint_every=1, starts="nominal", force=True)
    assert [row["tcs"] for row in again.evaluations.rows if row["episode"] in (2, 4)] == [
        row["tcs"] for row in whole.evaluations.rows]


class Constant:
    """A policy that gives one action, or one that depends on the observation."""

    def __init__(self, action, noise=0.0):
        self.action, self.noise = np.asarray(action, np.float32), noise

    def predict(self, observation, deterministic):
        assert deterministic
        return np.clip(self.action + self.noise * np.sin(observation[:3]), -1.0, 1.0), None


@pytest.mark.long
def test_a_saturated_policy_is_found_and_a_running_episode_goes_on(tmp_path):
    env = make_training_environment("SpoonTranslate", "none", REPEAT)
    evaluations = Evaluations(env, tmp_path, 1, {"nominal": True})
    motion = np.random.default_rng(0).uniform(-0.3, 0.3, (10, 3)).astype(np.float32)
    expected = [step.reward for step in run_episode(env, motion, seed=4)]
    env.reset(seed=4)
    rewards = [float(env.step(motion[0])[1])]
    for k in range(2 * PATIENCE):  # extreme, but not always the same
        evaluations.add(Constant([1.0, 1.0, 1.0], noise=-1.0 if k % 2 else 0.0), k + 1)
    evaluations.add(Constant([0.2, 0.0, 0.0]), 2 * PATIENCE + 1)
    with pytest.raises(SaturatedActor, match="end of its range"):
        for k in range(PATIENCE):
            evaluations.add(Constant([-1.0, 1.0, 1.0]), 2 * PATIENCE + 2 + k)
    rewards += [float(env.step(action)[1]) for action in motion[1:]]
    assert rewards == expected and issubclass(SaturatedActor, mpm.MpmError)

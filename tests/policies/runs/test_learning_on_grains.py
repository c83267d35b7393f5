"""A policy is trained on grains and must do what chance does not."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import wilcoxon

from policies.learning.environments import make_environment
from policies.learning.options import TrainingOptions
from policies.methods.train import train
from robosim.config.settings import read_setting
from robosim.episode.play import play
from robosim.studies.evaluation.suite_run import evaluate_suite

TASK, REPEAT, EVERY, EPISODES = "SpoonTranslate", 10, 5, 20
DEMONSTRATION = Path(__file__).resolve().parents[3] / "policies" / "trained" / "demonstrations" / f"{TASK}.npz"
SMALL = [read_setting(text) for text in (
    "obs=moments", "critic_layer_norm=true", "demonstrations.updates=4", "options.learning_rate=0.001",
    "options.ent_coef=auto_0.1", "options.policy_kwargs={net_arch: [64, 64]}")]
"""Of a learner that needs half a minute."""


@pytest.mark.slow
def test_a_policy_learns_to_carry_grains(tmp_path):
    """After twenty episodes it has delivered more than half of them in an evaluation, where no motion delivers none."""
    env = make_environment(TASK, action_repeat=REPEAT)
    assert play(env, np.zeros((100, 3), np.float32), options={"nominal": True})[1]["tcs"] == pytest.approx(-41.0)
    options = TrainingOptions(demos=DEMONSTRATION, evaluate_every=EVERY, action_repeat=REPEAT)
    assert train("dg_sac_literal", TASK, tmp_path, options, episodes=EPISODES, settings=SMALL) == 0
    scores = [float(row["tcs"]) for row in csv.DictReader((tmp_path / "evaluations.csv").read_text().splitlines())]
    status = json.loads((tmp_path / "status.json").read_text())
    assert len(scores) == EPISODES // EVERY and status["evaluated"]["best"]["tcs"] == pytest.approx(max(scores))
    assert max(scores) > 0.0
    assert (tmp_path / "best_policy.npz").is_file()


def test_a_policy_that_sees_the_target_beats_the_recording_where_targets_move(tmp_path):
    """ShovelMove on `wide`: held-out starts in pairs, by Wilcoxon's test."""
    options = TrainingOptions(randomize="wide", evaluate_every=20)
    assert train("dagger", "ShovelMove", tmp_path, options, episodes=40) == 0
    policies = [str(tmp_path / "best_policy.npz"), "recorded"]
    assert evaluate_suite("ShovelMove", policies, "wide", tmp_path / "judged", episodes=30, alone=True) == 0
    rows = list(csv.DictReader((tmp_path / "judged" / "evaluation.csv").read_text().splitlines()))
    learned, recorded = np.array([float(row["tcs"]) for row in rows]).reshape(2, 30)
    assert wilcoxon(learned, recorded, alternative="greater")[1] < 1e-3, (learned.mean(), recorded.mean())

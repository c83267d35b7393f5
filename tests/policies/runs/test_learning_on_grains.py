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
from policies.runs.learner_speed import measure_learner
from robosim.config.settings import read_setting
from robosim.episode.play import play
from robosim.studies.evaluation.suite_run import evaluate_suite

TASK, REPEAT, EVERY, EPISODES = "SpoonTranslate", 10, 5, 20
DEMONSTRATION = Path(__file__).resolve().parents[3] / "policies" / "trained" / "demonstrations" / f"{TASK}.npz"
SMALL = [read_setting(text) for text in (
    "obs=moments", "critic_layer_norm=true", "demonstrations.updates=4", "options.learning_rate=0.001",
    "options.ent_coef=auto_0.1", "options.policy_kwargs={net_arch: [64, 64]}")]
"""Of a learner that needs half a minute."""
CHANCE = 1e-3  # share of runs in which actions at random may reach what is asked of the policy


def chance_of_delivery(env) -> float:
    """Bound on the probability that actions drawn evenly from -1 to 1 deliver half of the grains in an episode.
    They are delivered by carrying them over the distance t to the edge of the target. An action moves the tool by up to
    a step s along the way, and the bounds of the action space hold it back, so that it ends at the largest of the sums
    over the last j actions. Each is at most t/s with probability 1 - exp(-3 (t/s)^2 / 2 j), because an even
    distribution is sub-Gaussian with its own variance 1/3: sinh(x)/x <= exp(x^2/6)."""
    task = env.unwrapped.task
    env.reset(seed=0, options={"nominal": True})
    y = np.sort(env.unwrapped.solver.positions()[:, 1])
    distance = task.target.centre[1] - task.target.half[1] - y[len(y) // 2]
    step = task.action.speed * REPEAT * task.step_dt
    assert distance > 0.0 and task.steps % REPEAT == 0
    decisions = np.arange(1, task.steps // REPEAT + 1)
    return float(np.exp(-1.5 * (distance / step) ** 2 / decisions).sum())


@pytest.mark.slow
def test_a_policy_learns_to_carry_grains(tmp_path):
    """After twenty episodes it has delivered more than half of them in an evaluation, where no motion delivers none.
    The score is then above 0, and -41 without motion. Chance has as many tries as there are evaluations."""
    env = make_environment(TASK, obs="moments", action_repeat=REPEAT)
    assert EPISODES // EVERY * chance_of_delivery(env) < CHANCE
    still = play(env, np.zeros((100, 3), np.float32), options={"nominal": True})[1]["tcs"]
    assert still == pytest.approx(-41.0)
    options = TrainingOptions(demos=DEMONSTRATION, evaluate_every=EVERY, action_repeat=REPEAT)
    assert train("dg_sac_literal", TASK, tmp_path, options, episodes=EPISODES, settings=SMALL) == 0
    scores = [float(row["tcs"]) for row in csv.DictReader((tmp_path / "evaluations.csv").read_text().splitlines())]
    status = json.loads((tmp_path / "status.json").read_text())
    assert len(scores) == EPISODES // EVERY and status["evaluated"]["best"]["tcs"] == pytest.approx(max(scores))
    assert max(scores) > 0.0
    assert (tmp_path / "best_policy.npz").is_file()


@pytest.mark.slow
def test_a_policy_that_sees_the_target_beats_the_recording_where_targets_move(tmp_path):
    """ShovelMove on `wide`: held-out starts in pairs, by Wilcoxon's test."""
    assert train("dagger", "ShovelMove", tmp_path, TrainingOptions(randomize="wide", evaluate_every=25)) == 0
    policies = [str(tmp_path / "best_policy.npz"), "learned"]
    assert evaluate_suite("ShovelMove", policies, "wide", tmp_path / "judged", episodes=50, alone=True) == 0
    rows = list(csv.DictReader((tmp_path / "judged" / "evaluation.csv").read_text().splitlines()))
    learned, recorded = np.array([float(row["tcs"]) for row in rows]).reshape(2, 50)
    assert wilcoxon(learned, recorded, alternative="greater")[1] < 1e-3, (learned.mean(), recorded.mean())


def test_updates_take_time_from_decisions() -> None:
    """`robosim bench learner`: a decision with its two updates takes at least a fifth longer than one without."""
    both, updates, alone = measure_learner(("SpoonTranslate",), 10).values()
    assert 0 < both < alone / 1.2 and both < updates

"""A policy that observes sensors alone is trained by Stable-Baselines3, as the guide shows, and beats no motion."""

import gymnasium
import numpy as np
import pytest
import torch
from scipy.stats import wilcoxon
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import robosim  # noqa: F401  (registers the environments)


class NoMotion:
    def __init__(self, dimensions: int) -> None:
        self._action = np.zeros((1, dimensions), np.float32)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self._action, state


def make_environment() -> Monitor:
    terms = ["tool", "wrist", {"name": "height_map", "pixels": (16, 16)}]
    return Monitor(gymnasium.make("robosim/SpoonTranslate-v0", obs=terms))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mpm.GrainsLeaveGrid")  # of a policy that has learned nothing yet
@pytest.mark.parametrize("seed", [0, 1])
def test_returns_of_a_sensed_policy_rise_above_no_motion(seed: int, tmp_path):
    """The best policy by trials on the way; the starts that are compared are others."""
    torch.set_num_threads(1)
    env, trial = make_environment(), make_environment()
    model = SAC("MultiInputPolicy", env, learning_rate=3e-4, gamma=0.95, learning_starts=300, seed=seed)
    model.learn(4000, EvalCallback(trial, eval_freq=250, best_model_save_path=str(tmp_path), verbose=0))
    returns = []
    for policy in (SAC.load(tmp_path / "best_model"), NoMotion(env.action_space.shape[0])):
        trial.reset(seed=1_000_000)
        rewards, _ = evaluate_policy(policy, trial, 20, deterministic=True, return_episode_rewards=True)
        returns.append(rewards)
    assert wilcoxon(*returns, alternative="greater").pvalue < 0.01

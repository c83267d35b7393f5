"""A policy that observes sensors alone is trained by Stable-Baselines3, as the guide shows, and beats no motion."""

import gymnasium
import numpy as np
import pytest
import torch
from scipy.stats import wilcoxon
from stable_baselines3 import SAC
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import robosim  # noqa: F401  (registers the environments)


class NoMotion:
    """A policy that leaves the tool where it is."""

    def __init__(self, dimensions: int) -> None:
        self._action = np.zeros((1, dimensions), np.float32)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self._action, state


@pytest.mark.slow
def test_returns_of_a_sensed_policy_rise_above_no_motion():
    torch.set_num_threads(1)
    terms = ["tool", "wrist", {"name": "height_map", "pixels": (16, 16)}]
    env = Monitor(gymnasium.make("robosim/SpoonTranslate-v0", obs=terms))
    model = SAC("MultiInputPolicy", env, learning_rate=1e-3, gamma=0.95, learning_starts=300, seed=0)
    model.learn(2000)
    returns = []
    for policy in (model, NoMotion(env.action_space.shape[0])):
        env.reset(seed=1_000_000)
        rewards, _ = evaluate_policy(policy, env, 20, deterministic=True, return_episode_rewards=True)
        returns.append(rewards)
    assert wilcoxon(*returns, alternative="greater").pvalue < 0.01

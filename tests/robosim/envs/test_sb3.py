"""Stable-Baselines3 in every sub-task: its checks, and its methods for a few episodes, without a warning."""

import warnings

import gymnasium
import numpy as np
import pytest
from grain_envs import play

import robosim  # noqa: F401  (registers the environments)
from robosim.envs import TASKS

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.monitor import Monitor

EPISODES, DECISIONS = 5, 20


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_methods_run_in_every_sub_task(name: str) -> None:
    """SB3's check, then five episodes each of SAC, PPO and an agent that acts at random."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = Monitor(gymnasium.make(f"robosim/{name}-v0", obs="moments", action_repeat=1000 // DECISIONS))
        check_env(env.unwrapped, skip_render_check=True)
        for method, options in ((SAC, {"learning_starts": 10, "batch_size": 16}), (PPO, {"n_steps": DECISIONS,
                                                                                         "batch_size": DECISIONS})):
            before = len(env.get_episode_rewards())
            method("MlpPolicy", env, seed=0, **options).learn(EPISODES * DECISIONS)
            assert len(env.get_episode_rewards()) - before == EPISODES
        env.action_space.seed(0)
        for seed in range(EPISODES):
            assert np.isfinite(play(env.unwrapped, lambda _: env.action_space.sample(), seed)[0])
    env.close()

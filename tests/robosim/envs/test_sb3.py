"""Stable-Baselines3 in every sub-task: its checks, and its methods for a few episodes, without a warning."""

import warnings

import gymnasium
import numpy as np
import pytest

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
        for _ in range(EPISODES):
            env.reset()
            over = False
            while not over:
                _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
                over = terminated or truncated
                assert np.isfinite(float(reward))
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_the_arm_passes_the_check_too(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(f"robosim/{name}-v0", obs="moments", arm=True).unwrapped, skip_render_check=True)


@pytest.mark.slow
def test_carrying_is_learnt_beyond_standing_still() -> None:
    """SAC as SB3 ships it, sixty episodes of SpoonTranslate: the best return is above that of no motion.

    Thirty end within one point of it, on whichever side rounding puts them; sixty are clear of it by forty.
    """
    env = Monitor(gymnasium.make("robosim/SpoonTranslate-v0", obs="moments"))
    env.reset(seed=0)
    still, over = 0.0, False
    while not over:
        _, reward, over, _, _ = env.step(np.zeros(3, np.float32))
        still += float(reward)
    before = len(env.get_episode_rewards())
    SAC("MlpPolicy", env, seed=0).learn(60 * 100)
    assert max(env.get_episode_rewards()[before:]) > still
    env.close()

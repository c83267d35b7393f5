"""Stable-Baselines3 in every sub-task: its checks, and its methods for a few episodes, without a warning."""

import warnings
from collections.abc import Callable

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


def play(env: gymnasium.Env, policy: Callable[[np.ndarray], np.ndarray], seed: int) -> float:
    """Return of an episode."""
    observation, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(policy(observation))
        total, over = total + float(reward), terminated or truncated
    return total


@pytest.mark.slow
def test_sac_learns_to_carry() -> None:
    """Sixty episodes of SpoonTranslate with SB3's own settings: without exploration, the learned policy earns more than
    a tool that stands still from each of five starts that it has not seen.

    It earned 20 and 85 more with two seeds, where returns of standing still differ by 3 between the starts; after
    thirty episodes it may still be below.
    """
    env = gymnasium.make("robosim/SpoonTranslate-v0", obs="moments")
    model = SAC("MlpPolicy", Monitor(env), seed=0).learn(60 * 100)
    for seed in range(100, 105):
        learned = play(env, lambda observation: model.predict(observation, deterministic=True)[0], seed)
        still = play(env, lambda observation: np.zeros(3, np.float32), seed)
        assert learned > still + 10.0, seed
    env.close()

"""SB3's face of a vector environment: nothing is lost on the way, and SB3's methods learn in it."""

import warnings
from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest

import mpm

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import VecMonitor

from policies.learning.vec_env import VectorFace


@pytest.fixture(scope="module")
def face() -> Iterator[VectorFace]:
    face = VectorFace(gymnasium.make_vec("robosim:robosim/SpoonTranslate-v0", num_envs=2, workers=1,
                                         obs="moments", action_repeat=250, horizon="truncate"))
    yield face
    face.close()


def test_an_episode_says_the_same_as_gymnasiums(face: VectorFace) -> None:
    """Ends, cuts, last observations and infos, over an end and into the next episode."""
    action = np.full((2, 3), 0.1, np.float32)
    expected = [face.vector.reset(seed=[4, 5])] + [face.vector.step(action) for _ in range(5)]
    face.seed(4)
    assert np.array_equal(face.reset(), expected[0][0])
    assert face.reset_infos[1]["tcs"] == expected[0][1]["tcs"][1]
    for k in range(1, 6):
        seen, rewards, over, rows = face.step(action)
        whole_seen, whole_rewards, ended, cut, infos = expected[k]
        assert np.array_equal(seen, whole_seen) and rewards == pytest.approx(whole_rewards)
        assert over.tolist() == [k == 4] * 2 == cut.tolist() and not ended.any()
        for e, row in enumerate(rows):
            assert row["TimeLimit.truncated"] == (k == 4)
            if k == 4:
                assert np.array_equal(row["terminal_observation"], infos["final_obs"][e])
                assert face.reset_infos[e]["tcs"] == infos["tcs"][e] and face.reset_infos[e]["time"] == 0.0
                assert row["reward_terms"]["lost"] == infos["final_info"]["reward_terms"]["lost"][e]
            else:
                assert row["readings"]["delivered"] == infos["readings"]["delivered"][e]


def test_methods_learn_in_it(face: VectorFace) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        watched = VecMonitor(face)
        soft = SAC("MlpPolicy", watched, learning_starts=4, batch_size=8, seed=0).learn(24)
        near = PPO("MlpPolicy", watched, n_steps=8, batch_size=8, n_epochs=1, seed=0).learn(16)
    assert soft.num_timesteps == 24 and near.num_timesteps == 16
    assert soft.ep_info_buffer is not None and len(soft.ep_info_buffer) == 6
    assert soft.ep_info_buffer[0]["l"] == 4


def test_what_it_cannot_do_is_said(face: VectorFace) -> None:
    assert face.env_is_wrapped(gymnasium.Wrapper, 0) == [False]
    for wrong in (lambda: face.set_attr("material", "salt"), lambda: face.env_method("rollout")):
        with pytest.raises(mpm.InvalidValue, match="VectorFace"):
            wrong()
    lazy = gymnasium.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    with pytest.raises(mpm.InvalidValue, match="accepted: AutoresetMode.SAME_STEP"):
        VectorFace(lazy)
    lazy.close()

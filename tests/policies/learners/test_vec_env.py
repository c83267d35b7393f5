"""Gymnasium vector environments in Stable-Baselines3: the same transitions, and learning from them."""

import warnings
from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import TD3
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

import mpm
from policies.learners.vec_env import SB3VecEnv


@pytest.fixture(scope="module")
def venv() -> Iterator[SB3VecEnv]:
    venv = SB3VecEnv(gymnasium.make_vec("robosim:robosim/SpoonTranslate-v0", num_envs=2, workers=1, obs="moments",
                                        action_repeat=250, horizon="truncate"))
    yield venv
    venv.close()


@pytest.mark.long
def test_transitions_are_those_of_gymnasium(venv: SB3VecEnv) -> None:
    """Dones, truncations, last observations and infos, through the end of an episode and into the next."""
    action = np.full((2, 3), 0.1, np.float32)
    expected = [venv.vector.reset(seed=[4, 5])] + [venv.vector.step(action) for _ in range(5)]
    venv.seed(4)
    assert np.array_equal(venv.reset(), expected[0][0]) and venv.reset_infos[1]["tcs"] == expected[0][1]["tcs"][1]
    for k in range(1, 6):
        observations, rewards, dones, rows = venv.step(action)
        expected_observations, expected_rewards, terminated, truncated, infos = expected[k]
        assert np.array_equal(observations, expected_observations) and rewards == pytest.approx(expected_rewards)
        assert dones.tolist() == [k == 4] * 2 == truncated.tolist() and not terminated.any()
        for e, row in enumerate(rows):
            assert row["TimeLimit.truncated"] == (k == 4)
            if k == 4:
                assert np.array_equal(row["terminal_observation"], infos["final_obs"][e])
                assert venv.reset_infos[e]["tcs"] == infos["tcs"][e] and venv.reset_infos[e]["time"] == 0.0
                assert row["reward_terms"]["lost"] == infos["final_info"]["reward_terms"]["lost"][e]
            else:
                assert row["readings"]["delivered"] == infos["readings"]["delivered"][e]


class Target(gymnasium.Env):
    """One decision an episode; the reward is highest where the action is the observation."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.target = self.np_random.uniform(-1.0, 1.0, 1).astype(np.float32)
        return self.target, {}

    def step(self, action):
        reward = -float(np.sum((action - self.target) ** 2))
        return self.target, reward, True, False, {}


def test_a_method_learns_in_it() -> None:
    """Each environment's action is rewarded by its own observation: mixed up, they teach nothing.
    Without learning the mean reward is about -0.67 for random actions and -0.33 for a constant one."""
    vector = gymnasium.vector.SyncVectorEnv([Target] * 4, autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        venv = VecMonitor(SB3VecEnv(vector))
        model = TD3("MlpPolicy", venv, learning_rate=1e-2, learning_starts=200, batch_size=64, gamma=0.0, seed=0,
                    policy_kwargs={"net_arch": [32]}).learn(1000)
    assert model.ep_info_buffer is not None and model.ep_info_buffer[0]["l"] == 1
    mean, _ = evaluate_policy(model, venv, n_eval_episodes=100)
    assert mean > -0.05
    venv.close()


def test_unsupported_calls_are_refused(venv: SB3VecEnv) -> None:
    assert venv.env_is_wrapped(gymnasium.Wrapper, 0) == [False]
    for call in (lambda: venv.set_attr("material", "salt"), lambda: venv.env_method("rollout")):
        with pytest.raises(mpm.InvalidValue, match="SB3VecEnv"):
            call()
    next_step = gymnasium.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    with pytest.raises(mpm.InvalidValue, match="accepted: AutoresetMode.SAME_STEP"):
        SB3VecEnv(next_step)
    next_step.close()

"""Playing one episode."""

import gymnasium
import numpy as np
import pytest

from robosim.episode.play import play, run_episode


class Countdown(gymnasium.Env):
    """Observes the decisions made; ends after `length`, or is truncated after `limit`; the reward is the action."""

    observation_space = action_space = gymnasium.spaces.Box(-9.0, 9.0, (1,), np.float32)

    def __init__(self, length: int, limit: int) -> None:
        self.length, self.limit = length, limit

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count, self.options = 0, options
        return np.array([0.0]), {}

    def step(self, action):
        self.count += 1
        return np.array([float(self.count)]), float(action[0]), self.count == self.length, \
            self.count == self.limit, {"count": self.count}


@pytest.mark.parametrize(("length", "limit", "truncated"), [(3, 9, False), (9, 3, True), (3, 3, False)])
def test_an_episode_ends_where_the_environment_ends_it(length, limit, truncated):
    """Observations of one step are those after the step before; a termination is no truncation."""
    env = Countdown(length, limit)
    steps = list(run_episode(env, np.arange(8.0)[:, None], seed=0, options={"nominal": True}))
    assert env.options == {"nominal": True} and env.count == 3
    assert [(step.observation[0], step.next_observation[0], step.reward, step.done) for step in steps] == [
        (0.0, 1.0, 0.0, False), (1.0, 2.0, 1.0, False), (2.0, 3.0, 2.0, True)]
    assert [step.info["TimeLimit.truncated"] for step in steps] == [False, False, truncated]


def test_a_motion_may_be_shorter_and_a_policy_sees_each_observation():
    assert play(Countdown(9, 9), np.ones((4, 1))) == (4.0, {"count": 4, "TimeLimit.truncated": False})
    assert play(Countdown(5, 9), lambda observation: 2.0 * observation)[0] == 2.0 * (0 + 1 + 2 + 3 + 4)


def test_an_episode_goes_on_from_its_observation_and_hooks_see_each_step():
    env, seen = Countdown(9, 9), []
    observation, _ = env.reset(seed=0)
    observation = env.step(np.ones(1))[0]
    total, _ = play(env, lambda observation: observation, observation=observation, hooks=[seen.append])
    assert total == 1 + 2 + 3 + 4 + 5 + 6 + 7 + 8 and [step.reward for step in seen] == list(range(1, 9))

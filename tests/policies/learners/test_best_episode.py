"""The best episode is the one with the largest return of all that were added, in either buffer and environment."""

import numpy as np
import pytest
import torch
from gymnasium import spaces

from policies.learners.buffers import DemoReplayBuffer
from policies.learners.soft_actor_critic import BestEpisode

LENGTH = 7


def add_episode(buffer: DemoReplayBuffer, number: int, rewards: list[float]) -> None:
    """Add an episode in each environment; its observations and actions tell number, step and environment."""
    n = len(rewards)
    for step in range(LENGTH):
        observations = np.array([[number, step, k] for k in range(n)], np.float32)
        buffer.add(observations, observations, np.tanh(observations[:, :2] / 10.0), np.array(rewards) / LENGTH,
                   np.full(n, step == LENGTH - 1), [{}] * n)


def make_buffer(n_envs: int = 1, size: int = 1000) -> DemoReplayBuffer:
    """Return an empty buffer."""
    return DemoReplayBuffer(size, spaces.Box(-99, 99, (3,), np.float32), spaces.Box(-1, 1, (2,), np.float32),
                            "cpu", n_envs=n_envs)


@pytest.mark.parametrize("every", [1, 3])
def test_it_is_the_one_with_the_largest_return(every: int) -> None:
    """Also where the buffer has begun again at its first row, and however seldom it is looked at."""
    buffer, best, rng = make_buffer(size=5 * LENGTH), BestEpisode(), np.random.default_rng(0)
    with buffer.demonstrating():
        add_episode(buffer, 100, [0.4])
    best.follow(buffer)
    assert best.best == pytest.approx(0.4) and float(best._observations[0, 0]) == 100.0
    highest, number = 0.4, 100
    for k in range(20):
        reward = float(rng.uniform())
        add_episode(buffer, k, [reward])
        if k % every == every - 1 or k == 19:
            best.follow(buffer)
        if reward > highest:
            highest, number = reward, k
    assert best.best == pytest.approx(highest, rel=1e-5)
    assert np.array_equal(best._observations.numpy()[:, :2], [[number, step] for step in range(LENGTH)])


def test_each_environment_has_episodes_of_its_own() -> None:
    buffer, best = make_buffer(n_envs=3), BestEpisode()
    add_episode(buffer, 1, [0.1, 0.9, 0.3])
    add_episode(buffer, 2, [0.2, 0.1, 0.8])
    best.follow(buffer)
    assert best.best == pytest.approx(0.9) and np.all(best._observations.numpy()[:, [0, 2]] == [1, 1])


def test_the_distance_is_that_of_the_actions() -> None:
    buffer, best = make_buffer(), BestEpisode()
    assert float(best.distance(None)) == 0.0
    add_episode(buffer, 3, [1.0])
    best.follow(buffer)

    def actor(observations: torch.Tensor, deterministic: bool) -> torch.Tensor:
        assert deterministic
        return torch.tanh(observations[:, :2] / 10.0) + 0.25

    assert float(best.distance(actor)) == pytest.approx(0.0625, rel=1e-5)

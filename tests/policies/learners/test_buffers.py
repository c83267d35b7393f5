"""The replay buffer of demonstrations and experience."""

import copy
import pickle
from contextlib import nullcontext

import gymnasium
import numpy as np
import pytest
import torch
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import DDPG, SAC, TD3

from policies.learners.buffers import DemoReplayBuffer, prefill_demo_buffer
from robosim.episode.play import run_episode

SMALL = {"learning_rate": 1e-3, "batch_size": 32, "learning_starts": 0, "policy_kwargs": {"net_arch": [32, 32]}}


def weights(model) -> np.ndarray:
    return np.concatenate([p.detach().numpy().ravel() for p in model.policy.parameters()])


def make_model(kind, **options):
    return kind("MlpPolicy", gymnasium.make("Pendulum-v1"), seed=3, device="cpu", **copy.deepcopy(SMALL), **options)


@pytest.mark.parametrize("kind, steps", [(SAC, 200), *(pytest.param(kind, 2000, marks=pytest.mark.slow)
                                                       for kind in (SAC, TD3, DDPG, TQC, CrossQ))])
def test_without_demonstrations_it_is_the_method_itself(kind, steps):
    """The same parameters after as many updates as steps."""
    models = [make_model(kind, **options).learn(steps) for options in ({}, {"replay_buffer_class": DemoReplayBuffer})]
    assert models[0]._n_updates >= steps - 10 and np.abs(weights(models[0]) - weights(models[1])).max() < 1e-6


def make_buffer(fraction: float, demos: int, own: int) -> DemoReplayBuffer:
    """A buffer whose rewards are 1 in demonstrations and 0 in the agent's transitions."""
    space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    buffer = DemoReplayBuffer(500, space, space, demo_size=100, demo_fraction=fraction)
    for k in range(demos + own):
        row = np.full((1, 2), k / 1000.0, np.float32)
        transition = (row, row, row, np.array([float(k < demos)]), np.array([False]), [{}])
        with buffer.demonstrating() if k < demos else nullcontext():
            buffer.add(*transition)
    return buffer


@pytest.mark.parametrize("fraction, demos, own, expected", [
    (0.5, 10, 20, 0.5), (0.25, 10, 20, 0.25), (0.0, 10, 20, 0.0), (1.0, 10, 20, 1.0), (0.5, 0, 20, 0.0),
    (0.5, 10, 0, 1.0), (0.0, 10, 0, 1.0)])
def test_batches_have_the_fraction_of_demonstrations(fraction, demos, own, expected):
    """All of one side while the other is empty; a buffer that was stored and loaded samples the same batches."""
    buffer = make_buffer(fraction, demos, own)
    np.random.seed(0)  # noqa: NPY002
    batch = buffer.sample(64)
    assert float(batch.rewards.mean()) == expected and batch.observations.shape == (64, 2)
    stored = pickle.dumps(buffer)
    assert len(stored) < 20_000  # rows in use, not the capacity
    loaded = pickle.loads(stored)
    np.random.seed(0)  # noqa: NPY002
    assert torch.equal(loaded.sample(64).observations, batch.observations)
    loaded.add(*[np.zeros((1, 2), np.float32)] * 3, np.zeros(1), np.zeros(1), [{}])
    assert loaded.size() == buffer.size() + 1


def test_dictionary_observations_are_stored():
    """A space of several parts, with the demonstrations' fraction."""
    Box = gymnasium.spaces.Box
    space = gymnasium.spaces.Dict({"a": Box(-1.0, 1.0, (2, 3)), "b": Box(-1.0, 1.0, (1,))})
    buffer = DemoReplayBuffer(20, space, Box(-1.0, 1.0, (2,)), demo_size=20)
    observation = {key: np.ones((1, *part.shape), np.float32) for key, part in space.items()}
    for k in range(4):
        transition = (observation, observation, np.ones((1, 2)), np.array([float(k % 2)]), np.array([False]), [{}])
        with buffer.demonstrating() if k % 2 else nullcontext():
            buffer.add(*transition)
    batch = pickle.loads(pickle.dumps(buffer)).sample(10)
    assert batch.observations["a"].shape == (10, 2, 3) and float(batch.rewards.mean()) == 0.5


def test_demonstrations_fill_the_buffer_with_updates(monkeypatch):
    """Every transition is stored as the environment made it, actions scaled, with one update after each."""
    env, model = gymnasium.make("Pendulum-v1"), make_model(SAC, replay_buffer_class=DemoReplayBuffer)
    model.learn(0)
    actions = np.full((50, 1), 0.5, np.float32)
    sizes, train = [], model.train
    monkeypatch.setattr(model, "train", lambda updates, batch_size: sizes.append(
        (updates, batch_size, model.replay_buffer.demo.size())) or train(updates, batch_size))
    before = weights(model)
    assert prefill_demo_buffer(model, run_episode(env, actions, seed=0), 1) == 50
    assert sizes == [(1, SMALL["batch_size"], k + 1) for k in range(50)]
    assert model._n_updates == 50 and np.abs(weights(model) - before).max() > 1e-4
    demo, steps = model.replay_buffer.demo, list(run_episode(env, actions, seed=0))
    assert demo.size() == 50 and model.replay_buffer.own.size() == 0
    assert np.allclose(demo.actions[:50], 0.25)  # torque 0.5 of 2
    for name, values in (("observations", [step.observation for step in steps]),
                         ("next_observations", [step.next_observation for step in steps])):
        assert np.array_equal(getattr(demo, name)[:50, 0], values)
    assert demo.rewards[:50, 0] == pytest.approx([step.reward for step in steps], rel=1e-6)

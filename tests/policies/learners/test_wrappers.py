"""Residual policies and delayed actors."""

from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
import torch

import mpm
from policies.learners.learner import build_learner
from policies.learners.wrappers import INITIAL_NOISE, ResidualActionWrapper, ScaledObservation
from policies.learning.presets import load_preset


def test_a_residual_policy_begins_with_no_correction():
    """Deterministic actions are zero, random ones small; learners without a standard deviation are refused."""
    env, preset = gymnasium.make("Pendulum-v1"), load_preset("residual")
    model = build_learner(preset, env, 0)
    observations = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32)
    assert not model.predict(observations, deterministic=True)[0].any()
    sampled = model.predict(observations)[0] / env.action_space.high
    assert 0.9 * INITIAL_NOISE < sampled.std() < 1.1 * INITIAL_NOISE
    for learner in ("DDPG", "PPO"):
        other = preset.model_copy(update={"learner": learner, "options": {}, "critic_layer_norm": False})
        with pytest.raises(mpm.InvalidValue, match=f"residual with learner {learner}"):
            build_learner(other, env, 0)


class ConstantReward(gymnasium.Env):
    """Every decision is rewarded with 1; the last action is stored."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.last_action = action
        return np.zeros(1, np.float32), 1.0, False, False, {}


def test_a_correction_is_added_and_costs():
    """The share is added within the bounds; the cost is the mean square of the correction before it is clipped."""
    inner = ConstantReward()
    env = ResidualActionWrapper(inner, np.array([[0.5, 0.95], [0.0, 0.0]], np.float32), 0.1, cost=2.0)
    env.reset()
    _, reward, _, _, _ = env.step(np.array([1.0, 1.0], np.float32))
    assert inner.last_action == pytest.approx([0.6, 1.0]) and reward == pytest.approx(1.0 - 2.0)
    _, reward, _, _, _ = env.step(np.array([-0.5, 0.0], np.float32))
    assert inner.last_action == pytest.approx([-0.05, 0.0]) and reward == pytest.approx(1.0 - 2.0 * 0.125)
    _, reward, _, _, _ = env.step(np.zeros(2, np.float32))  # after its end the motion's last action is repeated
    assert inner.last_action == pytest.approx([0.0, 0.0]) and reward == 1.0


def test_a_delayed_actor_does_not_change_while_its_critics_learn():
    """Bit for bit until its delay is over; then at its own rate. Without an `actor` in the preset the class is
    Stable-Baselines3's. A learner without an actor is refused."""
    preset = load_preset("residual")
    preset = preset.model_copy(update={"actor": preset.actor.model_copy(update={"waits": 60})})
    model = build_learner(preset, gymnasium.make("Pendulum-v1"), 0)

    def parameters(part):
        return torch.cat([p.detach().flatten().clone() for p in part.parameters()])

    actor, critic = parameters(model.actor), parameters(model.critic)
    model.learn(59)
    assert torch.equal(parameters(model.actor), actor) and not torch.equal(parameters(model.critic), critic)
    model.learn(5, reset_num_timesteps=False)
    assert not torch.equal(parameters(model.actor), actor)
    rates = {part: getattr(model, part).optimizer.param_groups[0]["lr"] for part in ("actor", "critic")}
    assert rates["actor"] == pytest.approx(preset.actor.rate * rates["critic"])
    plain = build_learner(load_preset("td3"), gymnasium.make("Pendulum-v1"), 0)
    assert type(plain).__module__.startswith("stable_baselines3")
    ppo = load_preset("ppo").model_copy(update={"actor": preset.actor})
    with pytest.raises(mpm.InvalidValue, match="actor with learner PPO; accepted: SAC"):
        build_learner(ppo, gymnasium.make("Pendulum-v1"), 0)


class NineGrains(gymnasium.Env):
    """Spaces, slices and task of an environment that observes nine grains."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (9 * 6 + 4,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
    observation_slices = {"particles": slice(0, 54), "tool": slice(54, 57), "time": slice(57, 58)}  # noqa: RUF012
    task = SimpleNamespace(goal=[0.1, 0.2, 0.3], action=SimpleNamespace(speed=0.5))
    world = SimpleNamespace(observer=SimpleNamespace(grains=np.arange(9)))


def test_grains_weigh_as_much_as_one_part():
    env = NineGrains()
    each, as_one = ScaledObservation(env, "flat"), ScaledObservation(env, "flat", grains_as_one=True)
    observation = np.random.default_rng(0).uniform(-1, 1, 58).astype(np.float32)
    expected = each.observation(observation)
    expected[:54] /= 3.0
    assert as_one.observation(observation) == pytest.approx(expected, rel=1e-5, abs=1e-6)

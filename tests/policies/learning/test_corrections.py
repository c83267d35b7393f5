"""Learning that corrects a demonstration."""

import gymnasium
import numpy as np
import pytest
import torch

import mpm
from policies.learning.learner import Corrected, build
from policies.learning.presets import load_preset


def test_what_corrects_a_demonstration_begins_with_it():
    """Deterministic actions are corrections of nothing, random ones small; a policy without a spread is refused."""
    from policies.learning.learner import FIRST_NOISE

    env, chosen = gymnasium.make("Pendulum-v1"), load_preset("residual")
    model = build(chosen, env, 0)
    seen = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32)
    assert not model.predict(seen, deterministic=True)[0].any()
    drawn = model.predict(seen)[0] / env.action_space.high
    assert 0.9 * FIRST_NOISE < drawn.std() < 1.1 * FIRST_NOISE
    for learner in ("DDPG", "PPO"):
        with pytest.raises(mpm.InvalidValue, match=f"residual with learner {learner}"):
            build(chosen.model_copy(update={"learner": learner, "options": {}, "critic_layer_norm": False}), env, 0)


class Even(gymnasium.Env):
    """Every decision earns 1; what was done last is kept."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.done = action
        return np.zeros(1, np.float32), 1.0, False, False, {}


def test_a_correction_is_added_and_paid_for():
    """Its share, within the bounds; the mean square of what was asked for, not of what came of it."""
    inner = Even()
    env = Corrected(inner, np.array([[0.5, 0.95], [0.0, 0.0]], np.float32), 0.1, cost=2.0)
    env.reset()
    _, reward, _, _, _ = env.step(np.array([1.0, 1.0], np.float32))
    assert inner.done == pytest.approx([0.6, 1.0]) and reward == pytest.approx(1.0 - 2.0)
    _, reward, _, _, _ = env.step(np.array([-0.5, 0.0], np.float32))
    assert inner.done == pytest.approx([-0.05, 0.0]) and reward == pytest.approx(1.0 - 2.0 * 0.125)
    _, reward, _, _, _ = env.step(np.zeros(2, np.float32))  # beyond its end the sequence's last counts
    assert inner.done == pytest.approx([0.0, 0.0]) and reward == 1.0


def test_an_actor_waits_while_its_critics_learn():
    """Bit for bit until its time has come; then at its own rate. With none asked for the class is stable_baselines3's.
    A learner without an actor is refused."""
    chosen = load_preset("residual")
    chosen = chosen.model_copy(update={"actor": chosen.actor.model_copy(update={"waits": 60})})
    model = build(chosen, gymnasium.make("Pendulum-v1"), 0)

    def parameters(part):
        return torch.cat([p.detach().flatten().clone() for p in part.parameters()])

    actor, critic = parameters(model.actor), parameters(model.critic)
    model.learn(59)
    assert torch.equal(parameters(model.actor), actor) and not torch.equal(parameters(model.critic), critic)
    model.learn(5, reset_num_timesteps=False)
    assert not torch.equal(parameters(model.actor), actor)
    rates = {part: getattr(model, part).optimizer.param_groups[0]["lr"] for part in ("actor", "critic")}
    assert rates["actor"] == pytest.approx(chosen.actor.rate * rates["critic"])
    plain = build(load_preset("sac"), gymnasium.make("Pendulum-v1"), 0)
    assert type(plain).__module__.startswith("stable_baselines3")
    ppo = load_preset("ppo").model_copy(update={"actor": chosen.actor})
    with pytest.raises(mpm.InvalidValue, match="actor with learner PPO; accepted: SAC"):
        build(ppo, gymnasium.make("Pendulum-v1"), 0)

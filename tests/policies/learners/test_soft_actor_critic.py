"""Soft actor-critic with an ensemble of critics, against Stable-Baselines3's own and against its definition."""

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.torch_layers import FlattenExtractor

from policies.learners.buffers import DemoReplayBuffer
from policies.learners.critics import CriticEnsemble, EnsemblePolicy
from policies.learners.soft_actor_critic import BestEpisode, EnsembleSAC, step

OBSERVED, ACTED, BATCH, STEPS = 7, 3, 16, 7


class Noise(gymnasium.Env):
    """An environment for models that are trained on transitions drawn at random."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (OBSERVED,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (ACTED,), np.float32)


def make_model(kind=EnsembleSAC, policy=EnsemblePolicy, net_arch=(12, 10), **policy_options):
    model = kind(policy, Noise(), seed=5, batch_size=BATCH, buffer_size=64, learning_rate=1e-2, device="cpu",
                 policy_kwargs={"net_arch": list(net_arch), **policy_options})
    model.set_logger(Logger(None, []))
    rng = np.random.default_rng(0)
    for _ in range(64):
        model.replay_buffer.add(*(rng.normal(size=(1, n)).astype(np.float32) for n in (OBSERVED, OBSERVED, ACTED)),
                                rng.normal(size=1), rng.random(1) < 0.2, [{}])
    return model


def copy_critics(source, target: CriticEnsemble) -> None:
    """Give an ensemble the weights of Stable-Baselines3's critics."""
    with torch.no_grad():
        for i, network in enumerate(source.q_networks):
            linear = [layer for layer in network if isinstance(layer, torch.nn.Linear)]
            target.of_features.weight[:, i] = linear[0].weight.T[:OBSERVED]
            target.of_action.weight[:, i] = linear[0].weight.T[OBSERVED:]
            target.of_features.bias[i, 0] = linear[0].bias
            for layer, one in zip(target.layers, linear[1:], strict=True):
                layer.weight[:, i], layer.bias[i, 0] = one.weight.T, one.bias


def test_critics_one_after_the_other_are_the_ensemble(monkeypatch):
    """The same values, and the same derivatives of every parameter."""
    space, actions = Noise.observation_space, Noise.action_space
    critics = CriticEnsemble(space, actions, [12, 10], FlattenExtractor(space), OBSERVED, n_critics=4, layer_norm=True)
    seen, acted, weight = torch.randn(BATCH, OBSERVED), torch.randn(BATCH, ACTED), torch.randn(4, BATCH)
    found = []
    for large in (2**18, 1):
        monkeypatch.setattr("policies.learners.critics.LARGE", large)
        critics.zero_grad()
        values = critics(seen, acted)
        (values * weight).sum().backward()
        found.append([values.detach(), *(parameter.grad.clone() for parameter in critics.parameters())])
    assert len(found[0]) == 1 + 3 + 2 * 4
    for together, apart in zip(*found, strict=True):
        assert apart.abs().max() > 0
        torch.testing.assert_close(apart, together, rtol=1e-4, atol=1e-6)


def test_the_ensemble_is_its_formula():
    """Values of each critic, and derivatives of every parameter and of the action, written out for one critic."""
    critic, functional = make_model(n_critics=3, layer_norm=True).critic, torch.nn.functional
    seen, acted = torch.randn(BATCH, OBSERVED), torch.rand(BATCH, ACTED, requires_grad=True)
    inputs = [acted, *critic.parameters()]
    for parameter in critic.parameters():
        torch.nn.init.normal_(parameter)
    expected = []
    for m in range(3):
        x = seen @ critic.of_features.weight[:, m] + acted @ critic.of_action.weight[:, m] + critic.of_features.bias[m]
        for norm, layer in zip(critic.norms, critic.layers):
            x = (x - x.mean(1, True)) / (x.var(1, unbiased=False, keepdim=True) + 1e-5).sqrt()
            x = functional.relu(x * norm.scale[m] + norm.shift[m]) @ layer.weight[:, m] + layer.bias[m]
        expected.append(x[:, 0])
    found, weight = critic(seen, acted), torch.randn(3, BATCH)
    torch.testing.assert_close(critic(seen, acted, torch.tensor([2, 0])), found[[2, 0]])
    for one, two in zip([found, *torch.autograd.grad((found * weight).sum(), inputs)], [
            torch.stack(expected), *torch.autograd.grad((torch.stack(expected) * weight).sum(), inputs)]):
        torch.testing.assert_close(one, two, rtol=1e-3, atol=1e-4)


def test_updates_are_those_of_the_library():
    """With two critics, from the same weights, batches and random numbers: actor, critics, targets and temperature."""
    theirs, ours = make_model(SAC, "MlpPolicy"), make_model()
    ours.actor.load_state_dict(theirs.actor.state_dict())
    for mine, other in ((ours.critic, theirs.critic), (ours.critic_target, theirs.critic_target)):
        copy_critics(other, mine)
    before = [parameter.clone() for parameter in ours.policy.parameters()]
    for model in (theirs, ours):
        np.random.seed(3)  # noqa: NPY002  (the buffer draws from it)
        torch.manual_seed(3)
        model.train(20, BATCH)
    for mine, other in zip(ours.actor.parameters(), theirs.actor.parameters(), strict=True):
        assert torch.allclose(mine, other, atol=2e-5)
    for mine, other in ((ours.critic, theirs.critic), (ours.critic_target, theirs.critic_target)):
        expected = make_model().critic
        copy_critics(other, expected)
        for one, two in zip(mine.parameters(), expected.parameters(), strict=True):
            assert torch.allclose(one, two, atol=2e-5)
    assert float(ours.log_ent_coef.detach()) == pytest.approx(float(theirs.log_ent_coef.detach()), abs=1e-5)
    assert any((old - new).abs().max() > 1e-2 for old, new in zip(before, ours.policy.parameters()))


def test_an_update_of_the_actor_leaves_the_critics_gradients_alone():
    """Only what an optimizer moves gets a gradient."""
    model = make_model()
    model.train(1, BATCH)
    grads = [parameter.grad.clone() for parameter in model.critic.parameters()]
    actions, log_prob = model.actor.action_log_prob(torch.randn(4, OBSERVED))
    step(model.actor.optimizer, (log_prob - model.critic(torch.randn(4, OBSERVED), actions).min(0)[0]).mean())
    for parameter, grad in zip(model.critic.parameters(), grads, strict=True):
        assert torch.equal(parameter.grad, grad)


def test_a_subset_gives_the_target_and_the_mean_moves_the_actor(monkeypatch):
    """Critics that answer with constants: the target is the smaller of two that were drawn, at random."""
    model = make_model(n_critics=5)
    model.subset, model.gamma = 2, 0.5
    constants = torch.arange(5.0)
    with torch.no_grad():
        model.critic_target.layers[-1].weight.zero_()
        model.critic_target.layers[-1].bias.copy_(constants[:, None, None])
    drawn, target = [], []
    forward = model.critic_target.forward
    monkeypatch.setattr(model.critic_target, "forward", lambda *given: drawn.append(given[2]) or forward(*given))
    batch = model.replay_buffer.sample(BATCH)
    monkeypatch.setattr("policies.learners.soft_actor_critic.functional.mse_loss",
                        lambda values, expected: target.append(expected) or ((values - expected) ** 2).mean())
    for _ in range(200):
        model._update_critics(batch, torch.tensor(0.0))
    least = torch.stack([constants[members].min() for members in drawn])
    assert all(len(set(members.tolist())) == 2 for members in drawn)
    seen = torch.stack([one[0] for one in target])
    expected = batch.rewards[:, 0] + (1 - batch.dones[:, 0]) * 0.5 * least[:, None]
    assert torch.allclose(seen, expected)
    # The smaller of two of 0..4 is 0 with probability 2/5: 80 of 200 draws, deviation 6.9; five of them are allowed.
    assert 45 <= int((least == 0).sum()) <= 115


def test_the_actor_waits_its_turn():
    """It moves in every third update; the critics in all."""
    model = make_model(n_critics=3)
    model.subset, model.actor_every = 2, 3
    moved = []
    for _ in range(6):
        actor, critic = ([p.clone() for p in part.parameters()] for part in (model.actor, model.critic))
        model.train(1, BATCH)
        moved.append(any((a - b).abs().max() > 0 for a, b in zip(actor, model.actor.parameters())))
        assert any((a - b).abs().max() > 0 for a, b in zip(critic, model.critic.parameters()))
    assert moved == [False, False, True, False, False, True]


def add_episode(buffer: DemoReplayBuffer, number: int, rewards: list[float]) -> None:
    """Add an episode in each environment; its observations and actions tell number, step and environment."""
    n = len(rewards)
    for decision in range(STEPS):
        observations = np.array([[number, decision, k] for k in range(n)], np.float32)
        buffer.add(observations, observations, np.tanh(observations[:, :2] / 10.0), np.array(rewards) / STEPS,
                   np.full(n, decision == STEPS - 1), [{}] * n)


def empty_buffer(n_envs: int = 1, size: int = 1000) -> DemoReplayBuffer:
    spaces = (gymnasium.spaces.Box(-bound, bound, (n,), np.float32) for bound, n in ((99, 3), (1, 2)))
    return DemoReplayBuffer(size, *spaces, "cpu", n_envs=n_envs)


@pytest.mark.parametrize("every", [1, 3])
def test_the_best_episode_is_the_one_with_the_largest_return(every: int) -> None:
    """Of all that were added; also where the buffer has begun again, and however seldom it is looked at."""
    buffer, best, rng = empty_buffer(size=5 * STEPS), BestEpisode(), np.random.default_rng(0)
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
    assert np.array_equal(best._observations.numpy()[:, :2], [[number, step] for step in range(STEPS)])


def test_each_environment_has_episodes_of_its_own() -> None:
    buffer, best = empty_buffer(n_envs=3), BestEpisode()
    add_episode(buffer, 1, [0.1, 0.9, 0.3])
    add_episode(buffer, 2, [0.2, 0.1, 0.8])
    best.follow(buffer)
    assert best.best == pytest.approx(0.9) and np.all(best._observations.numpy()[:, [0, 2]] == [1, 1])


def test_the_distance_is_that_of_the_actions() -> None:
    buffer, best = empty_buffer(), BestEpisode()
    assert float(best.distance(None)) == 0.0
    add_episode(buffer, 3, [1.0])
    best.follow(buffer)

    def actor(observations: torch.Tensor, deterministic: bool) -> torch.Tensor:
        assert deterministic
        return torch.tanh(observations[:, :2] / 10.0) + 0.25

    assert float(best.distance(actor)) == pytest.approx(0.0625, rel=1e-5)

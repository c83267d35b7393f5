"""Models built from presets."""

import gymnasium
import numpy as np
import pytest
import torch

from policies.learners.buffers import DemoReplayBuffer
from policies.learners.critics import WIDTH, PartsEncoder
from policies.learners.learner import ENCODERS, build_learner, learner_class
from policies.learning.presets import load_preset
from robosim.base.errors import ConfigError
from robosim.base.resources import config_names
from robosim.config.settings import Setting

BUILT = ("SAC", "TD3", "DDPG", "TQC", "CrossQ", "PPO", "GAIL")  # learners that are classes of Stable-Baselines3
OWN_OPTIONS = {"BC": {"learning_rate", "updates", "batch_size", "net_arch"},
               "DAgger": {"learning_rate", "updates", "batch_size", "net_arch", "expert_episodes", "noise", "closing"},
               "GNN-CMA-ES": {"knots", "sigma", "population"}, "replay": set()}
"""Options of the other learners, all of which a preset must give."""
SLICES = {"particles": slice(0, 24), "tool": slice(24, 31), "time": slice(31, 32)}


class Grains(gymnasium.Env):
    """An environment with spaces as of a sub-task with four grains, for models that are built only."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (32,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)


def widths(network) -> list[int]:
    return [layer.out_features for layer in network if isinstance(layer, torch.nn.Linear)]


@pytest.mark.parametrize("name", config_names("training"))
def test_a_model_has_every_setting_of_its_preset(name):
    """Options, network, buffer and the parts beyond Stable-Baselines3, read back from the model."""
    preset = load_preset(name)
    if preset.learner not in BUILT:
        assert set(preset.options) == OWN_OPTIONS[preset.learner]
        return
    model = build_learner(preset, Grains(), 0, SLICES)
    assert type(model) is learner_class(preset) or preset.actor is not None
    for option, value in preset.options.items():
        if option == "policy_kwargs":
            assert model.policy.net_arch == value["net_arch"]
        elif option == "learning_rate" and preset.decay != 1.0:
            assert model.learning_rate(1.0) == value and model.learning_rate(0.0) == pytest.approx(value * preset.decay)
        elif option == "ent_coef" and value.startswith("auto_"):
            assert float(torch.exp(model.log_ent_coef.detach())) == pytest.approx(float(value[5:]))
        else:
            assert getattr(model, option) == value, option
    if preset.learner in ("PPO", "GAIL"):
        assert widths(model.policy.mlp_extractor.policy_net) == [256, 256]
        return
    buffer, demos = model.replay_buffer, preset.demonstrations
    assert isinstance(buffer, DemoReplayBuffer) and buffer.own.buffer_size == preset.options["buffer_size"]
    if demos is not None:
        assert (buffer.demo.buffer_size, buffer.demo_fraction) == (demos.size, demos.fraction)
    assert (model.action_noise is not None) == (preset.learner in ("TD3", "DDPG"))
    critic, n = model.critic, 32
    if preset.encoder is not None:
        assert type(critic.features_extractor) is ENCODERS[preset.encoder]
        n = 2 * WIDTH if preset.encoder == "parts" else WIDTH + 8
    if preset.learner != "SAC":
        assert widths(critic.qf0) == [256, 256, 1]
        return
    assert (critic.norms is not None) == preset.critic_layer_norm
    assert (critic.embed is not None) == (preset.encoder == "parts")
    assert critic.count == (preset.critics.count if preset.critics else 2)
    assert model.subset == (preset.critics.subset if preset.critics else None)
    assert model.actor_every == (preset.actor.every if preset.actor else 1)
    hidden = preset.options["policy_kwargs"]["net_arch"]
    assert critic.of_features.weight.shape == (n, critic.count, hidden[0])
    assert [layer.weight.shape[2] for layer in critic.layers] == [*hidden[1:], 1]


@pytest.mark.parametrize("layer_norm", [False, True])
def test_parts_are_embedded_apart(layer_norm):
    """In actor and critics; the targets begin as copies, and all layers learn."""
    preset = load_preset("dg_sac_literal", [
        Setting(("encoder",), "parts"), Setting(("critic_layer_norm",), layer_norm)])
    model = build_learner(preset, Grains(), 0, SLICES)
    assert isinstance(model.actor.features_extractor, PartsEncoder)
    learning = {id(p) for group in model.critic.optimizer.param_groups for p in group["params"]}
    assert {id(p) for p in model.critic.parameters()} == learning
    rng = np.random.default_rng(0)
    observation = torch.as_tensor(rng.normal(size=(5, 32)), dtype=torch.float32)
    action = torch.as_tensor(rng.uniform(-1, 1, (5, 3)), dtype=torch.float32)
    assert torch.equal(model.critic(observation, action), model.critic_target(observation, action))
    assert not torch.allclose(model.critic(observation, -action)[0], model.critic(observation, action)[0], atol=1e-4)


def test_encoders_need_a_learner_and_scaled_observations_that_fit():
    for change, named in (({"encoder": "parts", "learner": "TD3"}, "TD3"),
                          ({"grains_as_one": True, "scaled": False}, "grains_as_one")):
        with pytest.raises(ConfigError, match=named):
            load_preset("dg_sac_literal", [Setting((key,), value) for key, value in change.items()])


def test_an_encoder_ignores_the_order_of_the_grains():
    """And nothing else: its features change with a grain's place and with the rest of the observation."""
    torch.manual_seed(0)
    network = ENCODERS["pointnet"](Grains.observation_space, SLICES)
    observation = torch.as_tensor(np.random.default_rng(0).normal(size=(2, 32)), dtype=torch.float32)
    shuffled, moved, later = observation.clone(), observation.clone(), observation.clone()
    shuffled[:, :24] = observation[:, :24].reshape(2, 4, 6)[:, [2, 0, 3, 1]].reshape(2, 24)
    moved[:, :3] += 1.0
    later[:, 31] += 1.0
    features = network(observation)
    assert features.shape == (2, network.features_dim) and torch.allclose(network(shuffled), features, atol=1e-6)
    assert not torch.allclose(network(moved), features, atol=1e-3)
    assert not torch.allclose(network(later), features, atol=1e-3)

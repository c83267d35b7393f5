"""Methods of stable_baselines3 and sb3_contrib, as presets ask for them."""

from typing import Any

import gymnasium
import numpy as np
import sb3_contrib
import stable_baselines3
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.policies import ContinuousCritic
from stable_baselines3.sac.policies import SACPolicy
from torch import nn
from torch.nn import functional

import mpm
from policies.learning.buffers import DemoReplayBuffer
from policies.learning.presets import Preset
from policies.learning.set_encoders import DeepSets, PointNet

CONTRIBUTED = ("TQC", "CrossQ")
NOISE = 0.1
"""Standard deviation of the exploration of methods whose policies are deterministic (Fujimoto et al. 2018)."""
FIRST_NOISE = 0.2
"""The same of corrections, at first."""
ENCODERS = {"pointnet": PointNet, "deep_sets": DeepSets}


class NormalisedReLU(nn.Module):
    """Layer normalisation without parameters, then max(0, x)."""

    def forward(self, x: Any) -> Any:
        """(..., features) to the same."""
        return functional.relu(functional.layer_norm(x, x.shape[-1:]))


class NormalisedCritic(SACPolicy):
    """A policy of SAC whose critics normalise their layers (Ball et al. 2023)."""

    def make_critic(self, features_extractor: Any = None) -> ContinuousCritic:
        """As stable_baselines3 makes it, with another activation."""
        given = self._update_features_extractor(self.critic_kwargs, features_extractor)
        return ContinuousCritic(**{**given, "activation_fn": NormalisedReLU}).to(self.device)


class Corrected(gymnasium.ActionWrapper):
    """Actions correct a sequence that is known: what is done is sequence + share * action, within -1 and 1. A decision
    pays cost times the mean square of its action: what a critic has seen too little of to judge is better left."""

    def __init__(self, env: gymnasium.Env, sequence: np.ndarray, share: float, cost: float = 0.0) -> None:
        super().__init__(env)
        self._sequence, self._share, self._cost, self._next = sequence, share, cost, 0

    def reset(self, **options: Any) -> Any:
        """Begin the sequence anew."""
        self._next = 0
        return self.env.reset(**options)

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's, less the cost."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, float(reward) - self._cost * float(np.mean(np.square(action))), terminated, truncated, info

    def action(self, action: np.ndarray) -> np.ndarray:
        """What is done."""
        known = self._sequence[min(self._next, len(self._sequence) - 1)]
        self._next += 1
        return np.clip(known + self._share * action, -1.0, 1.0).astype(np.float32)


class Patient:
    """Mixed into an actor-critic of stable_baselines3: its actor waits until so many decisions are made, and learns at
    another rate than its critics. One that begins with a good motion would leave it for whatever critics that have seen
    little overrate."""

    actor_waits, actor_rate = 0, 1.0
    num_timesteps: int
    actor: Any

    def _update_learning_rate(self, optimizers: Any) -> None:
        """As stable_baselines3 does before every update."""
        super()._update_learning_rate(optimizers)  # pyright: ignore[reportAttributeAccessIssue]
        for group in self.actor.optimizer.param_groups:
            group["lr"] *= self.actor_rate if self.num_timesteps >= self.actor_waits else 0.0


def kind_of(preset: Preset) -> Any:
    """The class of a preset's learner."""
    name = "PPO" if preset.learner == "GAIL" else preset.learner
    kind = getattr(sb3_contrib if name in CONTRIBUTED else stable_baselines3, name)
    return type(f"Patient{name}", (Patient, kind), {}) if preset.actor is not None else kind


def build(preset: Preset, env: Any, seed: int, slices: dict[str, slice] | None = None) -> Any:
    """A model that has learnt nothing yet; slices say where a flat observation has its grains. Raises mpm.InvalidValue
    for options that the class does not know."""
    kind, options = kind_of(preset), dict(preset.options)
    policy: Any = "MlpPolicy"
    inner = dict(options.pop("policy_kwargs", {}))
    if preset.critic_layer_norm:
        policy = NormalisedCritic
    if preset.encoder is not None:
        if not slices:
            raise mpm.InvalidValue(f"encoder {preset.encoder}: needs a task with grains, and obs: flat")
        inner |= {"features_extractor_class": ENCODERS[preset.encoder], "features_extractor_kwargs": {"slices": slices}}
    if preset.learner in ("TD3", "DDPG"):
        n = env.action_space.shape[0]
        options["action_noise"] = NormalActionNoise(np.zeros(n), np.full(n, NOISE))
    if preset.learner not in ("GAIL", "PPO"):  # without demonstrations the same bits, and smaller checkpoints
        shown = preset.demonstrations
        options["replay_buffer_class"] = DemoReplayBuffer
        options["replay_buffer_kwargs"] = {"demo_size": shown.size, "demo_fraction": shown.fraction} if shown else {
            "demo_size": 1}
    if isinstance(env.observation_space, gymnasium.spaces.Dict):
        policy = "MultiInputPolicy"
    try:
        model = kind(policy, env, seed=seed, policy_kwargs=inner, device="cpu", **options)
    except TypeError as error:
        raise mpm.InvalidValue(f"options of {preset.learner}: {error}") from error
    if preset.residual is not None:
        correct_nothing(model, preset.learner)
    if preset.actor is not None:
        if not hasattr(getattr(model, "actor", None), "optimizer"):
            raise mpm.InvalidValue(f"actor with learner {preset.learner}; accepted: SAC, TD3, DDPG, TQC or CrossQ")
        model.actor_waits, model.actor_rate = preset.actor.waits, preset.actor.rate
    return model


def correct_nothing(model: Any, learner: str) -> None:
    """Have a policy that corrects a sequence begin with the sequence itself, and little noise: with layers as they come
    its first episodes would leave what is to be corrected, and be all that the critic knows (Silver et al. 2018).
    Raises mpm.InvalidValue for learners other than SAC's kind."""
    actor = getattr(model, "actor", None)
    if actor is None or not isinstance(getattr(actor, "log_std", None), nn.Linear):
        raise mpm.InvalidValue(f"residual with learner {learner}; accepted: SAC, TQC or CrossQ, without use_sde")
    for layer, value in ((actor.mu, 0.0), (actor.log_std, float(np.log(FIRST_NOISE)))):
        nn.init.zeros_(layer.weight)
        nn.init.constant_(layer.bias, value)

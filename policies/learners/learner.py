"""Models of Stable-Baselines3 and sb3-contrib, built from presets."""

from typing import Any

import gymnasium
import numpy as np
import sb3_contrib
import stable_baselines3
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.torch_layers import CombinedExtractor
from stable_baselines3.common.utils import LinearSchedule

import mpm
from policies.learners.buffers import DemoReplayBuffer
from policies.learners.critics import DelayedActorMixin, EnsemblePolicy, PartsEncoder, PointNet
from policies.learners.pulses import HIDDEN
from policies.learners.soft_actor_critic import EnsembleSAC
from policies.learners.wrappers import zero_residual
from policies.learning.presets import Preset
from robosim.studies.policies import PULSED

NOISE = 0.1
"""Standard deviation of the noise by which deterministic policies explore (Fujimoto et al. 2018)."""
ENCODERS = {"pointnet": PointNet, "parts": PartsEncoder}


def learner_class(preset: Preset) -> Any:
    """Return the class of a preset's learner; GAIL's policy learns by PPO."""
    name = "PPO" if preset.learner == "GAIL" else preset.learner
    library = sb3_contrib if name in ("TQC", "CrossQ") else stable_baselines3
    kind = EnsembleSAC if name == "SAC" else getattr(library, name)
    return type(f"DelayedActor{name}", (DelayedActorMixin, kind), {}) if preset.actor is not None else kind


def build_learner(preset: Preset, env: Any, seed: int, slices: dict[str, slice] | None = None) -> Any:
    """Build an untrained model.
    slices: parts of a flat observation by name, which encoders need. Raises mpm.InvalidValue for options that the
    learner's class does not have, or parts of the preset that do not fit it."""
    kind, options = learner_class(preset), dict(preset.options)
    policy_options = dict(options.pop("policy_kwargs", {}))
    is_dict = isinstance(env.observation_space, gymnasium.spaces.Dict)
    policy: Any = "MultiInputPolicy" if is_dict else "MlpPolicy"
    if preset.learner == "SAC":
        policy = EnsemblePolicy
        policy_options = {"layer_norm": preset.critic_layer_norm, "embed_actions": preset.encoder == "parts",
                          "optimizer_kwargs": {"fused": True}, **policy_options}
        if is_dict:
            policy_options["features_extractor_class"] = CombinedExtractor
        if preset.expert == PULSED:
            policy_options["hidden"] = HIDDEN
        if preset.critics is not None:
            policy_options["n_critics"] = preset.critics.count
    if preset.encoder is not None:
        if not slices:
            raise mpm.InvalidValue(f"encoder {preset.encoder}: needs a task with grains, and obs: flat")
        policy_options |= {"features_extractor_class": ENCODERS[preset.encoder],
                           "features_extractor_kwargs": {"slices": slices}}
    if preset.decay != 1.0:
        rate = options["learning_rate"]
        options["learning_rate"] = LinearSchedule(rate, rate * preset.decay, 1.0)
    if preset.learner in ("TD3", "DDPG"):  # deterministic policies
        n = env.action_space.shape[0]
        options["action_noise"] = NormalActionNoise(np.zeros(n), np.full(n, NOISE))
    if preset.learner not in ("GAIL", "PPO"):
        # Also without demonstrations: same random numbers as SB3's own buffer, and smaller checkpoints.
        demos = preset.demonstrations
        options["replay_buffer_class"] = DemoReplayBuffer
        options["replay_buffer_kwargs"] = {"demo_size": demos.size, "demo_fraction": demos.fraction} if demos else {
            "demo_size": 1}
        n, updates = getattr(env, "num_envs", 1), options.get("gradient_steps", 1)
        if n > 1 and updates > 0:  # a number of updates for each transition, as with one environment
            options["gradient_steps"] = n * updates
    try:
        model = kind(policy, env, seed=seed, policy_kwargs=policy_options, device="cpu", **options)
    except (TypeError, ValueError, AssertionError, LookupError) as error:  # as Stable-Baselines3 refuses them
        raise mpm.InvalidValue(f"options of {preset.learner}: {type(error).__name__}: {error}") from error
    if preset.residual is not None:
        zero_residual(model, preset.learner)
    if preset.actor is not None:
        if not hasattr(getattr(model, "actor", None), "optimizer"):
            raise mpm.InvalidValue(f"actor with learner {preset.learner}; accepted: SAC, TD3, DDPG, TQC or CrossQ")
        model.actor_waits, model.actor_rate = preset.actor.waits, preset.actor.rate
        if preset.learner == "SAC":
            model.actor_every, model.imitation = preset.actor.every, preset.actor.imitation
            model.imitation_growth = preset.actor.imitation_growth
    if preset.critics is not None:
        model.subset = preset.critics.subset
    return model

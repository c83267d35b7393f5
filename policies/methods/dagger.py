"""DAgger (Ross, Gordon and Bagnell 2011): the policy acts, the script that knows the target's place says what to do."""

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.utils import set_random_seed

import mpm
from policies.methods.cloning import make_policy, update_policy
from policies.runs.training import Training
from robosim.episode.play import play
from robosim.studies.policies.script import ScriptedPolicy


def aggregate(training: Training) -> None:
    """Play episodes, those of the expert first, and fit the policy to its actions in all states so far.
    Options of the preset: those of cloning, with updates after each episode at a rate that falls to a tenth;
    expert_episodes; noise: standard deviation of what is added to the expert's own actions, so that it shows how to
    come back; closing: time constant [s] with which it does. In one action it would show a gain with which a tool that
    follows late, as an arm's does, overshoots. Raises mpm.InvalidValue for a task without a script."""
    if not training.is_granular:
        raise mpm.InvalidValue(f"task {training.task}: the expert is the task's script; accepted: a sub-task")
    set_random_seed(training.seed)
    options, env, policy = training.preset.options, training.base.unwrapped, make_policy(training)
    observations, actions = list[np.ndarray](), list[np.ndarray]()
    expert: Any = None
    if state := training.load_checkpoint():
        policy.load_state_dict(state["policy"])
        policy.optimizer.load_state_dict(state["optimizer"])
        observations, actions = list(state["observations"]), list(state["actions"])
        training.resume(state)

    def act(observation: np.ndarray) -> np.ndarray:
        nonlocal expert
        if env.step_count == 0:
            expert = ScriptedPolicy(env, knows=True, closing=options["closing"])
        observations.append(observation)
        actions.append(expert(observation))
        if training.env.count >= options["expert_episodes"]:
            return policy.predict(observation, deterministic=True)[0]
        noise = options["noise"] * torch.randn(len(actions[-1])).numpy()
        return np.clip(actions[-1] + noise, -1.0, 1.0).astype(np.float32)

    while not training.is_over:
        policy.set_training_mode(False)
        play(training.env, act)
        for group in policy.optimizer.param_groups:
            group["lr"] = options["learning_rate"] * (1.0 - 0.9 * training.env.count / training.preset.episodes)
        update_policy(policy, observations, actions, options)
        training.evaluate(policy)
        training.keep_checkpoint(policy=policy.state_dict(), optimizer=policy.optimizer.state_dict(),
                                 observations=np.array(observations), actions=np.array(actions))

"""Behaviour cloning, a policy fitted to the actions of demonstrations; and the replay of demonstrations."""

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.utils import set_random_seed

from policies.runs.training import Training
from robosim.episode.play import play


def clone(training: Training) -> None:
    """Fit a policy by least squares, then play every episode of the run with it."""
    set_random_seed(training.seed)
    policy = make_policy(training)
    if state := training.load_checkpoint():
        policy.load_state_dict(state["policy"])
        training.resume(state)
    else:
        transitions = list(training.demonstration_transitions())
        update_policy(policy, [step.observation for step in transitions], [step.action for step in transitions],
                      training.preset.options)
    policy.set_training_mode(False)

    def act(observation: Any) -> np.ndarray:
        return policy.predict(observation, deterministic=True)[0]

    while not training.is_over:
        play(training.env, act)
        training.evaluate(policy)
        training.keep_checkpoint(policy=policy.state_dict())


def make_policy(training: Training) -> ActorCriticPolicy:
    """Return a policy that is not fitted."""
    options = training.preset.options
    return ActorCriticPolicy(training.env.observation_space, training.env.action_space,
                             lambda _: options["learning_rate"], net_arch=options["net_arch"])


def update_policy(policy: ActorCriticPolicy, observations: list[np.ndarray], actions: list[np.ndarray],
                  options: dict[str, Any]) -> None:
    """Fit a policy by least squares to actions (dimensions,) in as many observations; options: of the preset."""
    seen, wanted = (torch.as_tensor(np.array(rows)) for rows in (observations, actions))
    for _ in range(options["updates"]):
        batch = torch.randint(len(seen), (options["batch_size"],))
        error = ((policy.get_distribution(seen[batch]).mode() - wanted[batch]) ** 2).mean()
        policy.optimizer.zero_grad()
        error.backward()
        policy.optimizer.step()


def replay(training: Training) -> None:
    """Play the demonstrations, one after the other."""
    if state := training.load_checkpoint():
        training.resume(state)
    for demonstration in training.demonstrations[training.env.count : training.preset.episodes]:
        play(training.env, demonstration.actions)
        training.keep_checkpoint()

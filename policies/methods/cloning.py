"""Behaviour cloning: the demonstrations' actions as a function of what was seen."""

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.utils import set_random_seed

from policies.runs.training import Training


def clone(training: Training) -> None:
    """Fit a policy to the demonstrations by least squares, then let it act in every episode of the run."""
    options = training.preset.options
    set_random_seed(training.seed)
    shown = list(training.demonstrated())
    seen = torch.as_tensor(np.array([step.observation for step in shown]))
    done = torch.as_tensor(np.array([step.action for step in shown]))
    policy = ActorCriticPolicy(training.env.observation_space, training.env.action_space,
                               lambda _: options["learning_rate"], net_arch=options["net_arch"])
    for _ in range(options["updates"]):
        batch = torch.randint(len(seen), (options["batch_size"],))
        error = ((policy.get_distribution(seen[batch]).mode() - done[batch]) ** 2).mean()
        policy.optimizer.zero_grad()
        error.backward()
        policy.optimizer.step()
    policy.set_training_mode(False)
    while not training.over:
        observation, over = training.env.reset()[0], False
        while not over:
            action, _ = policy.predict(observation, deterministic=True)
            observation, _, terminated, truncated, _ = training.env.step(action)
            over = terminated or truncated
        training.keep_best(policy)

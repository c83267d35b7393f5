"""Soft actor-critic with an ensemble of critics, whose actor may imitate the episode with the largest return so far.

Source of that idea: Oh et al. 2018, Self-Imitation Learning."""

from itertools import product
from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC
from torch.nn import functional

from policies.learners.buffers import map_parts


class BestEpisode:
    """Follows the two buffers of a `DemoReplayBuffer`, and keeps observations and actions of their best episode."""

    def __init__(self) -> None:
        self.best = -np.inf
        """Sum of its rewards."""
        self._observations: Any = None
        self._actions: torch.Tensor | None = None
        self._seen = {"demo": 0, "own": 0}
        """Rows of each buffer that were looked at; more than it holds where it has begun again at its first row."""
        self._begun: dict[tuple[str, int], list[int]] = {}
        """Buffer and environment -> rows of the episode that goes on."""

    def follow(self, buffers: Any) -> None:
        """Take over the rows that were added."""
        for name, seen in self._seen.items():
            buffer = getattr(buffers, name)
            added = np.arange(seen, seen + (buffer.pos - seen) % buffer.buffer_size) % buffer.buffer_size
            for row, k in product(added.tolist(), range(buffer.n_envs)):
                rows = self._begun.setdefault((name, k), [])
                rows.append(row)
                if buffer.dones[row, k]:
                    total = float(buffer.rewards[rows, k].sum())
                    if total > self.best:
                        self.best = total
                        self._observations, self._actions = (
                            map_parts(lambda part: torch.as_tensor(part[rows, k].copy()), whole)  # noqa: B023
                            for whole in (buffer.observations, buffer.actions))
                    rows.clear()
            self._seen[name] = buffer.pos

    def distance(self, actor: Any) -> torch.Tensor:
        """Return the mean square of an actor's distance from the episode's actions; zero before there is one."""
        if self._actions is None:
            return torch.zeros(())
        return (actor(self._observations, deterministic=True) - self._actions).pow(2).mean()


class EnsembleSAC(SAC):
    """SAC of Stable-Baselines3 with updates of its own; its policy is an `EnsemblePolicy`.

    With two critics the updates are those of Stable-Baselines3 up to rounding, in fewer operations: no gradients that
    nothing uses, and all critics in one product. subset: number of critics, drawn for each update, whose minimum is
    the target (Chen et al. 2021); the actor then follows the mean of all critics. None: the minimum of all, for both.
    actor_every: updates of the critics for one of the actor and the temperature. imitation: weight of the actor's
    distance from the actions of the best episode so far, a demonstration at first, in units of the mean value;
    imitation_growth: its factor at the end of the run, which it reaches geometrically."""

    subset: int | None = None
    actor_every = 1
    imitation = 0.0
    imitation_growth = 1.0
    best: BestEpisode | None = None
    critic: Any
    critic_target: Any

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Make updates with batches of the replay buffer."""
        self.policy.set_training_mode(True)
        of_temperature = [] if self.ent_coef_optimizer is None else [self.ent_coef_optimizer]
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer, *of_temperature])
        if self.imitation:
            self.best = self.best or BestEpisode()
            self.best.follow(self.replay_buffer)
        losses: dict[str, list[torch.Tensor]] = {name: [] for name in ("critic_loss", "actor_loss", "ent_coef_loss",
                                                                       "ent_coef")}
        for _ in range(gradient_steps):
            self._n_updates += 1
            self._update(self._n_updates % self.actor_every == 0, batch_size, losses)
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for name, values in losses.items():
            if values:
                self.logger.record(f"train/{name}", float(torch.stack(values).mean()))

    def _update(self, is_actors: bool, batch_size: int, losses: dict[str, list[torch.Tensor]]) -> None:
        """Update the critics with one batch, and the actor and the temperature too where it is their turn."""
        buffer: Any = self.replay_buffer
        batch = buffer.sample(batch_size, env=self._vec_normalize_env)
        if self.use_sde:
            self.actor.reset_noise()
        temperature: Any = self.ent_coef_tensor if self.log_ent_coef is None else self.log_ent_coef.detach().exp()
        losses["ent_coef"].append(temperature.mean())
        actions, log_prob = self.actor.action_log_prob(batch.observations) if is_actors else (None, None)
        if log_prob is not None and self.ent_coef_optimizer is not None:
            assert self.log_ent_coef is not None and isinstance(self.target_entropy, float)
            loss = -(self.log_ent_coef * (log_prob.detach() + self.target_entropy)).mean()
            step(self.ent_coef_optimizer, loss)
            losses["ent_coef_loss"].append(loss.detach())
        losses["critic_loss"].append(self._update_critics(batch, temperature))
        if actions is not None:
            with torch.no_grad():
                features = self.critic.features(batch.observations)
            values = self.critic.evaluate(features, actions)
            value = values.min(0)[0] if self.subset is None else values.mean(0)
            loss = (temperature * log_prob - value).mean()
            if self.best is not None:
                weight = self.imitation * self.imitation_growth ** (1.0 - self._current_progress_remaining)
                loss = loss + weight * value.detach().abs().mean() * self.best.distance(self.actor)
            step(self.actor.optimizer, loss)
            losses["actor_loss"].append(loss.detach())
        if self._n_updates % self.target_update_interval == 0:
            with torch.no_grad():
                for target, own in zip(self.critic_target.parameters(), self.critic.parameters(), strict=True):
                    target.lerp_(own, self.tau)

    def _update_critics(self, batch: Any, temperature: torch.Tensor) -> torch.Tensor:
        """Fit the critics to the rewards and the values of the next observations; return the loss."""
        with torch.no_grad():
            actions, log_prob = self.actor.action_log_prob(batch.next_observations)
            members = None if self.subset is None else torch.randperm(self.critic.count)[: self.subset]
            value = self.critic_target(batch.next_observations, actions, members).min(0)[0] - temperature * log_prob
            discount = self.gamma if batch.discounts is None else batch.discounts[:, 0]
            target = batch.rewards[:, 0] + (1 - batch.dones[:, 0]) * discount * value
        values = self.critic(batch.observations, batch.actions)
        loss = 0.5 * functional.mse_loss(values, target.expand_as(values)) * len(values)  # a sum over the critics
        step(self.critic.optimizer, loss)
        return loss.detach()


def step(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    """Move an optimizer's parameters down the gradient of a loss; no other parameter's gradient is computed."""
    optimizer.zero_grad()
    loss.backward(inputs=[parameter for group in optimizer.param_groups for parameter in group["params"]])
    optimizer.step()

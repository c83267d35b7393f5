"""Networks beyond Stable-Baselines3's own: encoders of grains, a delayed actor, and critics."""

from itertools import pairwise
from typing import Any

import gymnasium
import torch
from stable_baselines3.common.policies import BaseModel
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, FlattenExtractor
from stable_baselines3.sac.policies import SACPolicy
from torch import nn
from torch.nn import functional

WIDTH = 64
"""Features per grain."""


class DelayedActorMixin:
    """Mixed into an actor-critic of Stable-Baselines3: a delayed, slower actor.
    The actor makes its first update after `actor_waits` decisions, with a learning rate `actor_rate` x the critics'.
    An actor that starts from a good motion would otherwise follow critics that are still inaccurate."""

    actor_waits, actor_rate = 0, 1.0
    num_timesteps: int
    actor: Any

    def _update_learning_rate(self, optimizers: Any) -> None:
        """Set learning rates before an update, as Stable-Baselines3 calls it."""
        super()._update_learning_rate(optimizers)  # pyright: ignore[reportAttributeAccessIssue]
        for group in self.actor.optimizer.param_groups:
            group["lr"] *= self.actor_rate if self.num_timesteps >= self.actor_waits else 0.0


def embedding(size: int, width: int) -> nn.Sequential:
    """Return layers that embed `size` numbers, in units of their own, as `width` features."""
    return nn.Sequential(nn.Linear(size, width), nn.LayerNorm(width), nn.ReLU())


def cut_out(observations: torch.Tensor, part: slice) -> torch.Tensor:
    """Return observations (batch, n) without a part."""
    return torch.cat((observations[:, : part.start], observations[:, part.stop :]), 1)


class WithoutHidden(FlattenExtractor):
    """What an actor sees where critics see more (Pinto et al. 2018): observations without their last `hidden` numbers.
    """

    def __init__(self, space: gymnasium.Space, hidden: int) -> None:
        super().__init__(space)
        self._features_dim -= hidden

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Map (batch, observation) to (batch, observation - hidden)."""
        return super().forward(observations)[:, : self._features_dim]


class PartsEncoder(BaseFeaturesExtractor):
    """Embeds all grains in one layer and the rest of the observation in another, and joins them.
    slices: parts of the flat observation; "particles" holds the grains."""

    def __init__(self, space: gymnasium.Space, slices: dict[str, slice], width: int = WIDTH) -> None:
        assert space.shape is not None
        super().__init__(space, 2 * width)
        self._grains = slices["particles"]
        size = self._grains.stop - self._grains.start
        self._of_grains, self._of_rest = embedding(size, width), embedding(space.shape[0] - size, width)

    def forward(self, observations: torch.Tensor) -> Any:
        """Map (batch, observation) to (batch, features)."""
        rest = cut_out(observations, self._grains)
        return torch.cat((self._of_grains(observations[:, self._grains]), self._of_rest(rest)), 1)


class PointNet(BaseFeaturesExtractor):
    """A network applied to every grain, in world axes; the maximum of every feature, and the rest of the observation.
    Source: Qi et al. 2017. slices: parts of the flat observation; "particles" holds positions and velocities, 6 numbers
    a grain."""

    def __init__(self, space: gymnasium.Space, slices: dict[str, slice], width: int = WIDTH) -> None:
        grains = slices["particles"]
        assert space.shape is not None
        super().__init__(space, width + space.shape[0] - (grains.stop - grains.start))
        self._grains = grains
        self._each = nn.Sequential(*embedding(6, width), *embedding(width, width))

    def forward(self, observations: torch.Tensor) -> Any:
        """Map (batch, observation) to (batch, features)."""
        grains = observations[:, self._grains].reshape(len(observations), -1, 6)
        return torch.cat((self._each(grains).amax(1), cut_out(observations, self._grains)), 1)


EMBEDDING = 64
"""Features of an embedded action."""
LARGE = 2**18
"""Numbers that a layer of all critics gives, 1 MiB, from which they do not fit the cache. One after the other, ten
critics with 256 units and batches of 256 take 20 ms in place of 31, forward and back."""


class EnsembleLayer(nn.Module):
    """A layer of n networks: y = x W + b, its input their own or shared by all; initialised as `nn.Linear`.
    fan_in: inputs that the initialisation counts, where the layer is a part of a wider one; W: (inputs, n, outputs)."""

    def __init__(self, n: int, inputs: int, outputs: int, fan_in: int | None = None, bias: bool = True) -> None:
        super().__init__()
        bound = (fan_in or inputs) ** -0.5
        self.weight = nn.Parameter(torch.empty(inputs, n, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(n, 1, outputs).uniform_(-bound, bound)) if bias else None

    def forward(self, x: torch.Tensor, members: torch.Tensor | None = None,
                addend: torch.Tensor | None = None) -> torch.Tensor:
        """Map (batch, inputs), or (n, batch, inputs), to (n, batch, outputs), of the given members (None: all).
        addend: what a layer without a bias adds in its place."""
        W = (self.weight if members is None else self.weight[:, members]).transpose(0, 1)
        b: Any = addend if self.bias is None else self.bias if members is None else self.bias[members]
        return torch.baddbmm(b, x.expand(len(W), -1, -1), W)


class EnsembleNorm(nn.Module):
    """Layer normalisation of n networks, each with its own scale and shift."""

    def __init__(self, n: int, width: int) -> None:
        super().__init__()
        self.scale, self.shift = nn.Parameter(torch.ones(n, 1, width)), nn.Parameter(torch.zeros(n, 1, width))

    def forward(self, x: torch.Tensor, members: torch.Tensor | None = None) -> torch.Tensor:
        """Map (n, batch, width) to the same shape."""
        scale, shift = (part if members is None else part[members] for part in (self.scale, self.shift))
        return torch.addcmul(shift, functional.layer_norm(x, x.shape[-1:]), scale)


class CriticEnsemble(BaseModel):
    """n critics of an observation and an action.
    layer_norm: whether hidden layers are normalised (Ball et al. 2023). embed_actions: whether each critic embeds the
    action before it joins it to the observation: 3 numbers among 1000 leave little trace. images: options of
    Stable-Baselines3's base class for observations that are images."""

    def __init__(self, observation_space: Any, action_space: Any, net_arch: list[int], features_extractor: Any,
                 features_dim: int, n_critics: int = 2, layer_norm: bool = False, embed_actions: bool = False,
                 **images: Any) -> None:
        super().__init__(observation_space, action_space, features_extractor=features_extractor, **images)
        self.count, actions = n_critics, action_space.shape[0]
        width = EMBEDDING if embed_actions else actions
        self.embed = EnsembleLayer(self.count, actions, width) if embed_actions else None
        self.embed_norm = EnsembleNorm(self.count, width) if embed_actions else None
        first = net_arch[0] if net_arch else 1
        self.of_features = EnsembleLayer(self.count, features_dim, first, features_dim + width)
        self.of_action = EnsembleLayer(self.count, width, first, features_dim + width, bias=False)
        self.layers = nn.ModuleList(EnsembleLayer(self.count, a, b) for a, b in pairwise([*net_arch, 1]))
        self.norms = nn.ModuleList(EnsembleNorm(self.count, size) for size in net_arch) if layer_norm else None

    def forward(self, observations: Any, actions: torch.Tensor, members: torch.Tensor | None = None) -> torch.Tensor:
        """Return values (n, batch), of the given members only."""
        return self.evaluate(self.features(observations), actions, members)

    def features(self, observations: Any) -> torch.Tensor:
        """Return what all critics see of observations (batch, ...): features (batch, features)."""
        assert self.features_extractor is not None
        return self.extract_features(observations, self.features_extractor)

    def evaluate(self, features: torch.Tensor, actions: torch.Tensor,
                 members: torch.Tensor | None = None) -> torch.Tensor:
        """Return values (n, batch) of features and actions."""
        if members is None and self.embed is None and self.norms is not None \
                and self.count * len(actions) * self.of_features.weight.shape[2] >= LARGE:
            return self._evaluate_by_member(features, actions)
        x = actions
        if self.embed is not None and self.embed_norm is not None:
            x = self.embed_norm(self.embed(actions, members), members).relu_()
        x = self.of_action(x, members, self.of_features(features, members))
        for k, layer in enumerate(self.layers):
            if self.norms is not None:
                x = self.norms[k](x, members)
            x = layer(x.relu_(), members)
        return x.squeeze(2)

    def _evaluate_by_member(self, features: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Return what `evaluate` does, one critic after the other: what each computes then stays in the cache."""
        assert self.of_features.bias is not None and self.norms is not None
        firsts = self.of_features.bias.unbind(0), self.of_features.weight.unbind(1), self.of_action.weight.unbind(1)
        pairs: Any = zip(self.norms, self.layers, strict=True)
        rest = [tuple(zip(norm.scale.unbind(0), norm.shift.unbind(0), layer.bias.unbind(0), layer.weight.unbind(1)))
                for norm, layer in pairs]
        values = []
        for m, (b, W, of_a) in enumerate(zip(*firsts)):
            x = torch.addmm(b, features, W).addmm_(actions, of_a)
            for scale, shift, b, W in (parts[m] for parts in rest):
                x = torch.addmm(b, functional.layer_norm(x, x.shape[-1:], scale[0], shift[0]).relu_(), W)
            values.append(x[:, 0])
        return torch.stack(values)


class EnsemblePolicy(SACPolicy):
    """SAC's policy with its critics as an ensemble; options as of `CriticEnsemble`.
    hidden: numbers at the end of an observation that its actor does not see."""

    def __init__(self, *arguments: Any, layer_norm: bool = False, embed_actions: bool = False, hidden: int = 0,
                 **options: Any) -> None:
        self._critic_options: dict[str, Any] = {"layer_norm": layer_norm, "embed_actions": embed_actions}
        self._hidden = hidden
        super().__init__(*arguments, **options)

    def make_actor(self, features_extractor: Any = None) -> Any:
        """Make the actor."""
        if self._hidden and features_extractor is None:
            features_extractor = WithoutHidden(self.observation_space, self._hidden)
        return super().make_actor(features_extractor)

    def make_critic(self, features_extractor: Any = None) -> Any:
        """Make the critics."""
        given = self._update_features_extractor(self.critic_kwargs, features_extractor)
        kept = {key: value for key, value in given.items() if key not in ("activation_fn", "share_features_extractor")}
        return CriticEnsemble(**kept, **self._critic_options).to(self.device)

"""Policies as .npz files: the layers of a network as arrays, without code to execute."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from mpm.files import write

ACTIVATIONS = {nn.ReLU: "relu", nn.Tanh: "tanh"}


def deterministic_layers(policy: Any) -> tuple[list[nn.Module], str] | None:
    """Return the layers from a flat observation to the deterministic action, and how the action is bounded.
    The bound is "tanh" or "clip". None for a policy that is not a chain of layers."""
    extractor = getattr(policy, "features_extractor", None) or getattr(policy.actor, "features_extractor", None)
    if not isinstance(extractor, FlattenExtractor):
        return None
    if hasattr(policy, "mlp_extractor"):
        return [*policy.mlp_extractor.policy_net, policy.action_net], "clip"
    if hasattr(policy.actor, "latent_pi"):
        return [*policy.actor.latent_pi, policy.actor.mu], "tanh"
    return list(policy.actor.mu), "clip"


def export_policy(policy: Any, path: Path, units: tuple[np.ndarray, np.ndarray] | None = None, **metadata: Any) -> bool:
    """Write a policy of Stable-Baselines3 and metadata to a .npz file; return whether it can be written so.
    units: offset and factor (n,) each, of a policy whose input is (observation - offset) * factor; the file's first
    layer takes the observation itself."""
    chain = deterministic_layers(policy)
    if chain is None or any(type(layer) not in (nn.Linear, *ACTIVATIONS) for layer in chain[0]):
        return False
    arrays, activations = {"bound": np.array(chain[1])}, []
    for layer in chain[0]:
        if isinstance(layer, nn.Linear):
            arrays[f"weight_{len(activations)}"] = layer.weight.detach().numpy().copy()
            arrays[f"bias_{len(activations)}"] = layer.bias.detach().numpy().copy()
            activations.append("none")
        else:
            activations[-1] = ACTIVATIONS[type(layer)]
    if units is not None:
        offset, factor = units
        W = arrays["weight_0"].astype(float)
        arrays["bias_0"] = (arrays["bias_0"] - W @ (offset * factor)).astype(np.float32)
        arrays["weight_0"] = (W * factor).astype(np.float32)
    arrays["activations"] = np.array(activations)
    write(path, partial(np.savez, **arrays, **{key: np.asarray(value) for key, value in metadata.items()}))
    return True

"""Policies as files that anybody can load: the layers of a network in a .npz file, nothing that executes."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from torch import nn

from policies.learning.files import write

ACTIVATIONS = {nn.ReLU: "relu", nn.Tanh: "tanh"}


def layers(policy: Any) -> tuple[list[nn.Module], str] | None:
    """What makes a deterministic action of a flat observation, and how it is kept within bounds; None for a policy
    that is more than a chain of layers."""
    extractor = getattr(policy, "features_extractor", None) or getattr(policy.actor, "features_extractor", None)
    if type(extractor).__name__ != "FlattenExtractor":
        return None
    if hasattr(policy, "mlp_extractor"):
        return [*policy.mlp_extractor.policy_net, policy.action_net], "clip"
    if hasattr(policy.actor, "latent_pi"):
        return [*policy.actor.latent_pi, policy.actor.mu], "tanh"
    return list(policy.actor.mu), "clip"


def export(policy: Any, path: Path, units: tuple[np.ndarray, np.ndarray] | None = None, **more: Any) -> bool:
    """Write a policy of stable_baselines3, with what else is given; False where it cannot be written so. units: the
    policy sees (observation - units[0]) * units[1]; the file's first layer takes the observation itself."""
    found = layers(policy)
    if found is None or any(type(part) not in (nn.Linear, *ACTIVATIONS) for part in found[0]):
        return False
    arrays: dict[str, np.ndarray] = {"bound": np.array(found[1])}
    kinds = []
    for part in found[0]:
        if isinstance(part, nn.Linear):
            arrays[f"weight_{len(kinds)}"] = part.weight.detach().numpy().copy()
            arrays[f"bias_{len(kinds)}"] = part.bias.detach().numpy().copy()
            kinds.append("none")
        else:
            kinds[-1] = ACTIVATIONS[type(part)]
    if units is not None:
        W = arrays["weight_0"].astype(float)
        arrays["bias_0"] = (arrays["bias_0"] - W @ (units[0] * units[1])).astype(np.float32)
        arrays["weight_0"] = (W * units[1]).astype(np.float32)
    arrays["activations"] = np.array(kinds)
    write(path, partial(np.savez, **arrays, **{key: np.asarray(value) for key, value in more.items()}))
    return True

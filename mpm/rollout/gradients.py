"""All derivatives of a rollout; those by the numbers of a material come from those by the parameters of its law."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from mpm.errors import InvalidValue
from mpm.rollout.kernel import AdjointKernel
from mpm.rollout.tool_twists import TwistGradient
from mpm.scene.body import Body

DIFFERENCE = 1e-6
"""Relative step of the central differences through a law's `parameters`, in double precision."""


class Gradients(NamedTuple):
    """All derivatives of the last `value_and_grad`."""

    value: float
    twists: TwistGradient
    """With respect to the twists, and to position and orientation at the start."""
    materials: list[dict[str, float]]
    """With respect to each body's parameters, such as {"E": ..., "nu": ...}; empty without `materials`."""
    norms: np.ndarray
    """Norms of the derivatives with respect to positions [1/m] and velocities [s/m] before each step (n_steps, 2)."""


def material_gradients(bodies: list[Body], kernel: AdjointKernel) -> list[dict[str, float]]:
    """Return for each body the derivatives of the loss with respect to its parameters except density."""
    if not kernel.materials:
        return []
    bars = kernel.parameter_bars.to_numpy()
    gradients = []
    for body, bar in zip(bodies, bars):
        law, slopes = body.material, {}
        for field in dataclasses.fields(law):
            value = getattr(law, field.name)
            if isinstance(value, float | int) and not isinstance(value, bool) and field.name != "density":
                slopes[field.name] = float(slope(law, field.name, float(value)) @ bar[: len(law.parameters)])
        gradients.append(slopes)
    return gradients


def slope(law: Any, name: str, value: float) -> np.ndarray:
    """Return the derivative of a law's parameters by one number; one-sided where a side is not accepted."""
    step = DIFFERENCE * abs(value) if value else DIFFERENCE
    ends = []
    for end in (value + step, value, value - step):
        try:
            ends.append((end, np.array(dataclasses.replace(law, **{name: end}).parameters)))
        except InvalidValue:  # beyond what the law accepts
            continue
    if len(ends) < 2:
        return np.zeros(len(law.parameters))
    (high, above), (low, below) = ends[0], ends[-1]
    return (above - below) / (high - low)

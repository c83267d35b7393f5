"""Derivatives by what a material is given, from those by the numbers that kernels read."""

import dataclasses

import numpy as np

from mpm.errors import InvalidValue

DIFFERENCE = 1e-6
"""Relative step of the central differences through a law's `parameters`, in double precision."""


def material_bars(solver, sweep) -> list[dict[str, float]]:  # noqa: ANN001
    """For each body the derivative of the loss by each of its law's numbers but the density."""
    if not sweep.materials:
        return []
    bars = sweep.numbers_bar.to_numpy()
    found = []
    for body, bar in zip(solver.bodies, bars):
        law, slopes = body.material, {}
        for field in dataclasses.fields(law):
            value = getattr(law, field.name)
            if isinstance(value, float | int) and field.name != "density":
                slopes[field.name] = float(slope(law, field.name, float(value)) @ bar[: len(law.parameters)])
        found.append(slopes)
    return found


def slope(law, name: str, value: float) -> np.ndarray:  # noqa: ANN001
    """Derivative of a law's parameters by one of its numbers; to one side where the other is not accepted."""
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

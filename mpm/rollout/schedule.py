"""The checkpoint schedule: how many states a rollout stores, and how often it is repeated for the others."""

import math
from typing import NamedTuple

from mpm.errors import InvalidValue

DEPTH = 24
"""Levels of checkpoints at most; a rollout of 2^24 steps needs no more."""


class Schedule(NamedTuple):
    """A rollout of `steps` is split into `parts` parts, each of these again, `levels` times; a last part has at most
    `chunk` steps, all of whose substeps are kept side by side."""

    steps: int
    chunk: int
    parts: int
    levels: int
    slots: int
    """States side by side."""
    checkpoints: int
    """States at the beginnings of parts."""
    n_bytes: int
    """Memory of all of them."""

    @property
    def recomputation(self) -> int:
        """How often a step is repeated at most."""
        return self.levels


def plan_schedule(steps: int, substeps: int, n_bytes: int, budget: int) -> Schedule:
    """Return the schedule with the least recomputation whose states, of n_bytes each, fit into a budget [bytes].
    Raises InvalidValue where none fits."""
    smallest = math.inf
    for levels in range(DEPTH + 1):
        plan = _smallest(steps, substeps, n_bytes, levels)
        smallest = min(smallest, plan.n_bytes)
        if plan.n_bytes <= budget:
            return plan
    raise InvalidValue(f"Rollout: {steps} steps of {substeps} substeps do not fit into a budget of {budget} bytes; "
                       f"accepted: {smallest} bytes or more")


def _smallest(steps: int, substeps: int, n_bytes: int, levels: int) -> Schedule:
    """Return the schedule with so many levels that takes the least memory."""
    if levels == 0:
        chunks = [(steps, 1)]
    else:
        most = math.ceil(steps ** (1.0 / levels)) + 1
        chunks = [(math.ceil(steps / parts**levels), parts) for parts in range(2, most + 1)]
    plans = []
    for chunk, parts in chunks:
        slots = chunk * substeps + 1
        # the start's state, and a state for every further part of every level; with none, the start's beside the slots
        checkpoints = 1 + levels * (parts - 1)
        plans.append(Schedule(steps, chunk, parts, levels, slots, checkpoints, (slots + checkpoints) * n_bytes))
    return min(plans, key=lambda plan: plan.n_bytes)

"""Options of a rollout, and its checkpoint schedule: how many states it stores, how often it is repeated for others."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from mpm.errors import InvalidValue

BUDGET = 1_000_000_000  # bytes that the states of a rollout may take
DEPTH = 24  # levels of checkpoints at most; a rollout of 2^24 steps needs no more


@dataclass(frozen=True, kw_only=True)
class RolloutOptions:
    """How a rollout is computed; raises InvalidValue for numbers out of range."""

    step_dt: float = 2e-3
    """Time [s] of a step."""
    budget: int = BUDGET
    """Largest memory [bytes] of the stored states; see `schedule`."""
    materials: bool = False
    """Whether to compute derivatives with respect to material parameters too."""
    limit: float | None = None
    """Each entry of the state's adjoint is clipped to +-limit in every substep; None: not clipped."""
    window: int | None = None
    """The state's adjoint is set to zero every `window` steps; None: never."""
    soft: float = 0.0
    """Relative width over which derivatives smooth the yield surface; 0: not smoothed."""
    svd: bool = False
    """Differentiate the strain as autodiff of a singular value decomposition does; for comparison only."""
    substeps: int | None = None
    """Number per step; None: from the solver's dt."""

    def __post_init__(self) -> None:
        if not self.step_dt > 0 or not math.isfinite(self.step_dt):
            raise InvalidValue(f"Rollout: step_dt = {self.step_dt} s; accepted: a positive time")
        if self.substeps is not None and (self.substeps != int(self.substeps) or self.substeps < 1):
            raise InvalidValue(f"Rollout: substeps = {self.substeps}; accepted: a whole number, 1 or more, or None")
        if self.window is not None and self.window < 1:
            raise InvalidValue(f"Rollout: window = {self.window} steps; accepted: 1 or more, or None")
        if self.limit is not None and not self.limit > 0:
            raise InvalidValue(f"Rollout: limit = {self.limit}; accepted: a positive number, or None")
        if not 0 <= self.soft < math.inf:
            raise InvalidValue(f"Rollout: soft = {self.soft}; accepted: 0 or more")


class Schedule(NamedTuple):
    """A rollout of `steps` is split into `parts` parts, each of these again, `levels` times; a last part has at most
    `chunk` steps, all of whose substeps are kept side by side."""

    steps: int
    chunk: int
    parts: int
    levels: int
    slots: int  # states side by side
    checkpoints: int  # states at the beginnings of parts
    n_bytes: int  # memory of all of them


def plan_schedule(steps: int, substeps: int, n_bytes: int, budget: int, aside: int = 0) -> Schedule:
    """Return the schedule with the least recomputation whose states, of n_bytes each, fit into a budget [bytes].
    aside: states kept beside those of the substeps. Raises InvalidValue where none fits."""
    smallest = math.inf
    for levels in range(DEPTH + 1):
        plan = _smallest(steps, substeps, n_bytes, levels, aside)
        smallest = min(smallest, plan.n_bytes)
        if plan.n_bytes <= budget:
            return plan
    raise InvalidValue(f"Rollout: {steps} steps of {substeps} substeps do not fit into a budget of {budget} bytes; "
                       f"accepted: {smallest} bytes or more")


def _smallest(steps: int, substeps: int, n_bytes: int, levels: int, aside: int) -> Schedule:
    """Return the schedule with so many levels that takes the least memory."""
    if levels == 0:
        chunks = [(steps, 1)]
    else:
        most = math.ceil(steps ** (1.0 / levels)) + 1
        chunks = [(math.ceil(steps / parts**levels), parts) for parts in range(2, most + 1)]
    plans = []
    for chunk, parts in chunks:
        slots = chunk * substeps + 1 + aside  # the first state, and aside what half a kick leads to
        # the start's state, and a state for every further part of every level; with none, the start's beside the slots
        checkpoints = 1 + levels * (parts - 1)
        plans.append(Schedule(steps, chunk, parts, levels, slots, checkpoints, (slots + checkpoints) * n_bytes))
    return min(plans, key=lambda plan: plan.n_bytes)

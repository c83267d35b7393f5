"""Options of a rollout."""

import math
from dataclasses import dataclass

from mpm.errors import InvalidValue

BUDGET = 1_000_000_000
"""Bytes that the states of a rollout may take."""


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

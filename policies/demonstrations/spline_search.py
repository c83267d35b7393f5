"""Smooth motions as splines, and a search for one without gradients: CMA-ES on its knots (Hansen 2016)."""

from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import CubicSpline

import mpm

KNOTS, SIGMA, POPULATION = 8, 0.3, 10
"""Knots of the spline, initial standard deviation of the actions, motions in a generation."""
FAILED = 1e9
"""Loss of a motion that diverges."""


def sample_spline(knots: np.ndarray, decisions: int) -> np.ndarray:
    """Return actions (decisions, dimensions) along a cubic spline through knots (n, dimensions), within -1 and 1."""
    times = np.linspace(0.0, 1.0, len(knots))
    return np.clip(CubicSpline(times, knots)(np.linspace(0.0, 1.0, decisions)), -1.0, 1.0).astype(np.float32)


def fit_knots(actions: np.ndarray, knots: int) -> np.ndarray:
    """Return the knots (n, dimensions) of the spline closest to actions (decisions, dimensions)."""
    times = np.linspace(0.0, 1.0, len(actions))
    basis = CubicSpline(np.linspace(0.0, 1.0, knots), np.eye(knots))(times)
    return np.linalg.lstsq(basis, actions, rcond=None)[0]


class SplineSearch:
    """A search for actions (n, k) of least loss, one motion of a generation at a time.
    The first `fixed` rows are not changed. Raises mpm.InvalidValue where the package cma is not installed."""

    uses_gradient: ClassVar[bool] = False
    check_every: ClassVar[int] = POPULATION
    """Iterations between two checks of convergence."""

    def __init__(self, first: np.ndarray, seed: int, fixed: int = 0) -> None:
        try:
            import cma  # of the extra `learn`, which other commands do not need
        except ImportError as error:
            raise mpm.InvalidValue(f"--method cmaes: {error}; pip install '.[learn]' in the checkout") from error
        rng = np.random.default_rng(seed)  # by default cma draws from numpy's global generator
        self._search: Any = cma.CMAEvolutionStrategy(fit_knots(first[fixed:], KNOTS).ravel(), SIGMA, {
            "seed": np.nan, "randn": lambda *size: rng.standard_normal(size), "popsize": POPULATION, "verbose": -9})
        self._fixed_actions, self._free, self._losses = first[:fixed].copy(), len(first) - fixed, []
        self.best, self.lowest = first.copy(), np.inf
        self._points = self._search.ask()
        self._select_next()

    def _select_next(self) -> None:
        knots = self._points[len(self._losses) % POPULATION].reshape(KNOTS, -1)
        self.now = np.concatenate([self._fixed_actions, sample_spline(knots, self._free)])

    def step(self, loss: float, gradient: np.ndarray | None = None) -> None:
        """Take the loss at `now`, and set the next `now`."""
        if loss < self.lowest:
            self.lowest, self.best = loss, self.now.copy()
        self._losses.append(loss)
        if len(self._losses) % POPULATION == 0:
            self._search.tell(self._points, np.minimum(self._losses[-POPULATION:], FAILED).tolist())
            self._points = self._search.ask()
        self._select_next()

    def fail(self) -> None:
        """Take an infinite loss at `now`."""
        self.step(np.inf)

    def convergence_losses(self, losses: list[float]) -> list[float]:
        """Return the lowest loss up to the end of every generation."""
        return list(np.minimum.accumulate(losses)[POPULATION - 1 :: POPULATION])

    def state(self) -> dict[str, np.ndarray]:
        """Return the losses so far: the search is repeated from them."""
        return {"losses": np.array(self._losses)}

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Restore a state, into a new search of the same seed."""
        for loss in state["losses"]:
            self.step(float(loss))

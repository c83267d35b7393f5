"""A search for a demonstration without gradients: CMA-ES (Hansen 2016) on the knots of a smooth motion."""

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import mpm

KNOTS, SIGMA, POPULATION = 8, 0.3, 10
"""Of a search for a demonstration: knots of the spline, first spread of the actions, motions in a generation."""
FAILED = 1e9
"""Loss of a motion that no loss could be found for."""


def motion(knots: np.ndarray, decisions: int) -> np.ndarray:
    """Actions (decisions, dimensions) along a spline through knots (n, dimensions), within -1 and 1."""
    places = np.linspace(0.0, 1.0, len(knots))
    return np.clip(CubicSpline(places, knots)(np.linspace(0.0, 1.0, decisions)), -1.0, 1.0).astype(np.float32)


def fitted(actions: np.ndarray, knots: int) -> np.ndarray:
    """Knots (n, dimensions) whose spline is closest to actions."""
    places = np.linspace(0.0, 1.0, len(actions))
    basis = CubicSpline(np.linspace(0.0, 1.0, knots), np.eye(knots))(places)
    return np.linalg.lstsq(basis, actions, rcond=None)[0]


class Evolution:
    """A search for actions (n, k) of the least loss, a motion at a time: `now` is to be tried, `step` is told how it
    went. The first `kept` rows stay as they are. Its state is what it was told: a search that goes on is told it
    again."""

    population = POPULATION

    def __init__(self, first: np.ndarray, seed: int, kept: int = 0) -> None:
        try:
            import cma  # belongs to the extra of learning, and other commands do without it
        except ImportError as error:
            raise mpm.InvalidValue(f"--method cmaes: {error}; pip install '.[learn]' in the checkout") from error
        rng = np.random.default_rng(seed)  # the library would take numpy's own, which belongs to everybody
        self._search: Any = cma.CMAEvolutionStrategy(fitted(first[kept:], KNOTS).ravel(), SIGMA, {
            "seed": np.nan, "randn": lambda *size: rng.standard_normal(size), "popsize": POPULATION, "verbose": -9})
        self._begin, self._left, self._told = first[:kept].copy(), len(first) - kept, []
        self.best, self.lowest = first.copy(), np.inf
        self._points = self._search.ask()
        self._take()

    def _take(self) -> None:
        knots = self._points[len(self._told) % POPULATION].reshape(KNOTS, -1)
        self.now = np.concatenate([self._begin, motion(knots, self._left)])

    def step(self, loss: float) -> None:
        """Take the loss at `now`, and move on."""
        if loss < self.lowest:
            self.lowest, self.best = loss, self.now.copy()
        self._told.append(loss)
        if len(self._told) % POPULATION == 0:
            self._search.tell(self._points, np.minimum(self._told[-POPULATION:], FAILED).tolist())
            self._points = self._search.ask()
        self._take()

    def fail(self) -> None:
        """`now` has no loss."""
        self.step(np.inf)

    def course(self, losses: list[float]) -> list[float]:
        """The lowest loss so far at the end of every generation."""
        return list(np.minimum.accumulate(losses)[POPULATION - 1 :: POPULATION])

    def state(self) -> dict[str, np.ndarray]:
        """What the next steps depend on."""
        return {"told": np.array(self._told)}

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Return to a state, from a new search of the same seed."""
        for loss in state["told"]:
            self.step(float(loss))

"""Posterior distribution of the numbers sought: samples, intervals, correlation.

Readings have independent normal errors; before them every value in a number's range is equally likely. The variance of
an emulator adds to that of the readings. Samples are those of an ensemble with stretch moves (Goodman & Weare 2010,
Commun. Appl. Math. Comput. Sci. 5:65), which needs no step size.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

LogLikelihood = Callable[[np.ndarray], np.ndarray]
"""Returns the logarithm of the likelihood (m,) at points (m, d) in [0, 1]."""
WALKERS, STEPS, DISCARDED, THINNING, START_POINTS = 64, 300, 100, 8, 1024
"""START_POINTS: that the ensemble begins among."""
STRETCH = 2.0
"""Largest stretch of a move, as Goodman & Weare recommend."""
INTERVAL = 0.9
"""Probability of an interval."""


class Posterior(NamedTuple):
    """Samples of the numbers sought, in [0, 1] of their ranges."""

    samples: np.ndarray
    """(s, d)"""
    best: np.ndarray
    """(d,) of the largest likelihood"""

    def intervals(self) -> np.ndarray:
        """Return least and largest value (d, 2) of the central intervals of probability INTERVAL."""
        return np.quantile(self.samples, (0.5 - INTERVAL / 2, 0.5 + INTERVAL / 2), axis=0).T

    def correlation(self) -> np.ndarray:
        """Return the correlation (d, d)."""
        return np.atleast_2d(np.corrcoef(self.samples.T))


def sample_posterior(log_likelihood: LogLikelihood, dimensions: int, seed: int) -> Posterior:
    """Sample the posterior, and climb from the best sample to the largest likelihood by gradient (L-BFGS-B)."""
    rng = np.random.default_rng(seed)
    starts = qmc.Sobol(dimensions, rng=rng).random(START_POINTS)
    logs = log_likelihood(starts)
    weights = np.exp(logs - logs.max())
    few = np.argsort(-logs)[:WALKERS]  # where one start has all the weight, the ensemble would have no extent
    drawn = rng.choice(len(starts), WALKERS // 2, p=weights / weights.sum())
    walkers = np.concatenate([starts[few[: WALKERS - len(drawn)]], starts[drawn]])
    walkers = np.clip(walkers + rng.normal(0.0, 1e-3, walkers.shape), 0.0, 1.0)
    logs, kept, halves = log_likelihood(walkers), [], (slice(0, WALKERS // 2), slice(WALKERS // 2, WALKERS))
    for step in range(STEPS):
        for half, other in (halves, halves[::-1]):
            walkers[half], logs[half] = _move(walkers[half], logs[half], walkers[other], log_likelihood, rng)
        if step >= DISCARDED and (step - DISCARDED) % THINNING == 0:
            kept.append(walkers.copy())
    return Posterior(np.concatenate(kept), climb(log_likelihood, walkers[np.argmax(logs)]))


def _move(walkers: np.ndarray, logs: np.ndarray, others: np.ndarray, log_likelihood: LogLikelihood,
          rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a half of the ensemble after a stretch move along the lines to walkers of the other half."""
    n, d = walkers.shape
    stretch = (1 + rng.random(n) * (np.sqrt(STRETCH) - 1 / np.sqrt(STRETCH)) * np.sqrt(STRETCH)) ** 2 / STRETCH
    partner = others[rng.integers(0, len(others), n)]
    proposed = partner + stretch[:, None] * (walkers - partner)
    inside = ((proposed >= 0.0) & (proposed <= 1.0)).all(1)
    new = np.full(n, -np.inf)
    if inside.any():
        new[inside] = log_likelihood(proposed[inside])
    accepted = np.log(rng.random(n)) < (d - 1) * np.log(stretch) + new - logs
    return np.where(accepted[:, None], proposed, walkers), np.where(accepted, new, logs)


def climb(log_likelihood: LogLikelihood, start: np.ndarray) -> np.ndarray:
    """Return the point (d,) of the largest likelihood uphill of a start (d,)."""
    found = minimize(lambda point: -float(log_likelihood(np.clip(point, 0, 1)[None])[0]), start, method="L-BFGS-B",
                     bounds=[(0.0, 1.0)] * len(start), options={"eps": 1e-4})
    return np.clip(found.x, 0.0, 1.0) if found.fun <= -log_likelihood(start[None])[0] else start

"""Search: which numbers are simulated, and the posterior that follows.

A Sobol sequence fills the ranges; then each round fits the emulators, samples the posterior, and runs those samples at
which an emulator is least certain (posterior sampling). It ends when no emulator matters beside the errors of the
readings, or with the last run. Experiments with a closed form need none of it.

Readings have independent normal errors; before them every value in a number's range is equally likely. The variance of
an emulator adds to that of the readings. Samples are those of an ensemble with stretch moves (Goodman & Weare 2010,
Commun. Appl. Math. Comput. Sci. 5:65), which needs no step size."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from robosim.studies.calibration.emulator import Emulator
from robosim.studies.calibration.experiment import Numbers, Trial

FIRST_RUNS = 6
"""Runs of the space-filling start for each number sought."""
APART = 0.02
"""Least distance of a run from earlier ones, in ranges: nearer ones tell the noise alone."""
SETTLED = 0.01
"""Variance of the emulators, in those of the readings, at which they move the best numbers by a tenth of a standard
deviation: an emulator's error is alike over a whole experiment, so that its readings do not average it out."""

Run = Callable[[Trial, Numbers, int], np.ndarray]
"""Simulates a trial, or finds what is stored of an earlier run."""
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


class Ranges(NamedTuple):
    """Ranges of the numbers sought, in order."""

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, sought: dict[str, tuple[float, float]]) -> "Ranges":
        """Make them of a table name -> (least, largest)."""
        low, high = np.array(list(sought.values()), float).T
        return cls(tuple(sought), low, high)

    def numbers(self, point: np.ndarray) -> Numbers:
        """Return the numbers at a point (d,) in [0, 1]."""
        return dict(zip(self.names, self.scaled(point).tolist()))

    def scaled(self, points: np.ndarray) -> np.ndarray:
        """Return points (..., d) in [0, 1] in the numbers' own units."""
        return self.lower + points * (self.upper - self.lower)


class Search(NamedTuple):
    """What a search found."""

    posterior: Posterior
    emulators: dict[str, Emulator]
    points: np.ndarray
    """(r, d) runs, in [0, 1]"""
    is_settled: bool
    """Whether the emulators no longer matter beside the errors of the readings."""


@threadpool_limits.wrap(limits=1)  # of BLAS: on matrices of 50 x 50 its threads wait for one another
def search(trials: Sequence[Trial], ranges: Ranges, run: Run, *, runs: int, seed: int = 0,
           report: Callable[[int], object] = lambda n: None) -> Search:
    """Search the ranges with at most `runs` simulations of each trial that has no closed form.
    run: simulates; with the same seed the search asks for the same runs in the same order, so that it can be continued.
    report: is called after each run, with 1."""
    d = len(ranges.names)
    simulated = [trial for trial in trials if not trial.is_direct]
    outputs: dict[str, list[np.ndarray]] = {trial.name: [] for trial in simulated}
    if not simulated:
        return Search(sample_posterior(likelihood(trials, ranges, {}), d, seed), {}, np.empty((0, d)), True)
    filling = qmc.Sobol(d, rng=np.random.default_rng(seed)).random(2 ** int(np.ceil(np.log2(FIRST_RUNS * d))))
    waiting, points = list(filling[: min(FIRST_RUNS * d, runs)]), []
    while True:
        for point in waiting:
            numbers = ranges.numbers(point)
            for trial in simulated:
                outputs[trial.name].append(run(trial, numbers, len(points)))
            points.append(point)
            report(1)
        done = np.array(points)
        emulators = {trial.name: Emulator(done, np.array(outputs[trial.name]) / trial.errors) for trial in simulated}
        posterior = sample_posterior(likelihood(trials, ranges, emulators), d, seed)
        uncertain = np.sum([emulator.uncertainty(posterior.samples) for emulator in emulators.values()], axis=0)
        is_settled = bool(uncertain.mean() < SETTLED)
        if is_settled or len(points) >= runs:
            return Search(posterior, emulators, done, is_settled)
        waiting = choose(posterior.samples, uncertain, done, min(4, runs - len(points)))


def choose(samples: np.ndarray, uncertain: np.ndarray, points: np.ndarray, n: int) -> list[np.ndarray]:
    """Return n of the samples (s, d), the least certain first, apart from the points (r, d) and from one another."""
    chosen: list[np.ndarray] = []
    for apart in (3 * APART, APART, 0.0):
        for k in np.argsort(-uncertain, kind="stable"):
            if len(chosen) == n:
                return chosen
            taken = np.array([*points, *chosen])
            if np.linalg.norm(taken - samples[k], axis=1).min() > apart:
                chosen.append(samples[k])
    return chosen


def predict(trial: Trial, points: np.ndarray, ranges: Ranges, emulators: dict[str, Emulator]
            ) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance (m, n) of a trial's outputs at points (m, d), in standard deviations of its readings."""
    if trial.name in emulators:
        return emulators[trial.name].predict(points)
    mean = np.array([trial.simulate(ranges.numbers(point), 0) for point in points]) / trial.errors
    return mean, np.zeros_like(mean)


def likelihood(trials: Sequence[Trial], ranges: Ranges, emulators: dict[str, Emulator]) -> LogLikelihood:
    """Return the logarithm of the likelihood of all readings, with the emulators' variance."""

    def log_likelihood(points: np.ndarray) -> np.ndarray:
        total = np.zeros(len(points))
        for trial in trials:
            mean, variance = predict(trial, points, ranges, emulators)
            spread = 1.0 + variance
            total -= 0.5 * ((trial.readings / trial.errors - mean) ** 2 / spread + np.log(spread)).sum(1)
        return total

    return log_likelihood

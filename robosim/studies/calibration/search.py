"""Search: which numbers are simulated, and the posterior that follows.

A Sobol sequence fills the ranges; then each round fits the emulators, samples the posterior, and runs those samples at
which an emulator is least certain (posterior sampling). It ends when no emulator matters beside the errors of the
readings, or with the last run. Experiments with a closed form need none of it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from robosim.studies.calibration.emulator import Emulator
from robosim.studies.calibration.experiment import Numbers, Trial
from robosim.studies.calibration.posterior import LogLikelihood, Posterior, sample_posterior

FIRST_RUNS = 6
"""Runs of the space-filling start for each number sought."""
APART = 0.02
"""Least distance of a run from earlier ones, in ranges: nearer ones tell the noise alone."""
SETTLED = 0.01
"""Variance of the emulators, in those of the readings, at which they move the best numbers by a tenth of a standard
deviation: an emulator's error is alike over a whole experiment, so that its readings do not average it out."""

Run = Callable[[Trial, Numbers, int], np.ndarray]
"""Simulates a trial, or finds what is stored of an earlier run."""


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
    report: is called after each run, with 1.
    """
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

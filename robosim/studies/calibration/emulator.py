"""Emulator of a simulated experiment: Gaussian processes on the principal components of its outputs.

Outputs are divided by their errors first, so that all numbers here are in standard deviations of the readings; the
numbers of the material are scaled to 0 to 1 in their ranges. A process has a length scale for each number and a term of
noise, which takes up what the particles' places change. Source: Higdon et al. 2008, J. Am. Stat. Assoc. 103:570.
"""

import warnings
from typing import Any

import numpy as np
from scipy.linalg import cho_solve
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

NEGLIGIBLE = 0.1
"""Root mean square [standard deviations of the readings] of a component that is left to the noise."""
MOST_COMPONENTS = 6
LENGTHS = (0.05, 10.0)
"""Bounds of length scales, in ranges of the numbers: runs are farther apart than the least; beyond ten ranges an output
is linear."""
NOISE = (1e-6, 1.0)
"""Bounds of the noise's variance, relative to a component's."""


class Emulator:
    """Predicts an experiment's outputs from those of some runs.

    points: (r, d) numbers of the material in [0, 1]; outputs: (r, n) in standard deviations of the readings.
    """

    def __init__(self, points: np.ndarray, outputs: np.ndarray) -> None:
        self._mean = outputs.mean(0)
        left, sizes, right = np.linalg.svd(outputs - self._mean, full_matrices=False)
        spread = sizes / np.sqrt(len(points))
        kept = max(int((spread > NEGLIGIBLE).sum()), 1)
        kept = min(kept, MOST_COMPONENTS, len(sizes))
        self._basis = right[:kept]
        scores = left[:, :kept] * sizes[:kept]
        self._lost = ((outputs - self._mean - scores @ self._basis) ** 2).mean(0)
        self._scale = np.maximum(scores.std(0), 1e-12)
        self._processes = [Process(fit_process(points, scores[:, k] / self._scale[k])) for k in range(kept)]

    def predict(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and variance (m, n) of the outputs at points (m, d), a run's own noise included."""
        means, variances = self._components(points)
        return (self._mean + means @ self._basis, variances @ self._basis**2 + self._lost)

    def distribution(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (n,) and covariance (n, n) of the outputs over points (m, d), the processes' own included.

        A process moves all readings of an experiment together, and so do the numbers.
        """
        means, variances = self._components(points)
        away = means - means.mean(0)
        components = away.T @ away / max(len(points) - 1, 1) + np.diag(variances.mean(0))
        return self._mean + means.mean(0) @ self._basis, self._basis.T @ components @ self._basis + np.diag(self._lost)

    def uncertainty(self, points: np.ndarray) -> np.ndarray:
        """Return the largest variance (m,) over the outputs at points (m, d) that more runs could remove."""
        _, variances = self._components(points)
        own = np.array([process.noise for process in self._processes]) * self._scale**2
        return (np.maximum(variances - own, 0.0) @ self._basis**2).max(1)

    def _components(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = [process.predict(points) for process in self._processes]
        means, variances = (np.stack(values, 1) for values in zip(*found))
        return means * self._scale, variances * self._scale**2


class Process:
    """A fitted process with the inverse of its covariance: sklearn solves for each prediction, 5 x as slow for few."""

    def __init__(self, fitted: Any) -> None:  # sklearn's kernels have no types
        self._fitted, self.noise = fitted, float(fitted.kernel_.k2.noise_level)
        self._inverse = cho_solve((fitted.L_, True), np.eye(len(fitted.L_)))

    def predict(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and variance (m,) at points (m, d), noise included."""
        kernel = self._fitted.kernel_
        cross = kernel(points, self._fitted.X_train_)
        known = ((cross @ self._inverse) * cross).sum(1)
        return cross @ self._fitted.alpha_, np.maximum(kernel.diag(points) - known, self.noise)


def fit_process(points: np.ndarray, values: np.ndarray) -> GaussianProcessRegressor:
    """Fit a process to values (r,) of unit variance at points (r, d) by maximum likelihood."""
    d = points.shape[1]
    lengths: Any = np.full(d, 0.5)
    kernel = ConstantKernel(1.0, (0.05, 100.0)) * Matern(lengths, LENGTHS, nu=2.5) + WhiteKernel(0.01, NOISE)
    process = GaussianProcessRegressor(kernel, n_restarts_optimizer=1, random_state=0)
    with warnings.catch_warnings():  # a length at its bound is a number that the output does not depend on
        warnings.simplefilter("ignore", ConvergenceWarning)
        return process.fit(points, values)

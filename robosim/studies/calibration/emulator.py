"""Emulator of a simulated experiment: Gaussian processes on the principal components of its outputs.
Outputs are divided by their errors first, so that all numbers here are in standard deviations of the readings; the
numbers of the material are scaled to 0 to 1 in their ranges. A process has a length scale for each number and a term of
noise, which takes up what the particles' places change. Source: Higdon et al. 2008, J. Am. Stat. Assoc. 103:570."""

import warnings
from typing import Any

import numpy as np
from scipy.linalg import cho_solve
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

LENGTHS = (0.05, 10.0)
"""Bounds of length scales, in ranges of the numbers: runs are farther apart than the least; beyond ten ranges an output
is linear."""


class Emulator:
    """Predicts an experiment's outputs from those of some runs.
    points: (r, d) numbers of the material in [0, 1]; outputs: (r, n) in standard deviations of the readings."""

    def __init__(self, points: np.ndarray, outputs: np.ndarray) -> None:
        self._mean = outputs.mean(0)
        left, sizes, right = np.linalg.svd(outputs - self._mean, full_matrices=False)
        # a component of a tenth of the readings' standard deviation, root mean square, is left to the noise
        kept = min(max(int((sizes / np.sqrt(len(points)) > 0.1).sum()), 1), 6, len(sizes))
        self._basis = right[:kept]
        scores = left[:, :kept] * sizes[:kept]
        self._lost = ((outputs - self._mean - scores @ self._basis) ** 2).mean(0)
        self._scale = np.maximum(scores.std(0), 1e-12)
        self._processes = [fit_process(points, scores[:, k] / self._scale[k]) for k in range(kept)]

    def predict(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and variance (m, n) of the outputs at points (m, d), a run's own noise included."""
        means, variances = self._components(points)
        return (self._mean + means @ self._basis, variances @ self._basis**2 + self._lost)

    def distribution(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (n,) and covariance (n, n) of the outputs over points (m, d), the processes' own included.
        A process moves all readings of an experiment together, and so do the numbers."""
        means, variances = self._components(points)
        away = means - means.mean(0)
        components = away.T @ away / max(len(points) - 1, 1) + np.diag(variances.mean(0))
        return self._mean + means.mean(0) @ self._basis, self._basis.T @ components @ self._basis + np.diag(self._lost)

    def uncertainty(self, points: np.ndarray) -> np.ndarray:
        """Return the largest variance (m,) over the outputs at points (m, d) that more runs could remove."""
        _, variances = self._components(points)
        own = np.array([process.kernel_.k2.noise_level for process, _ in self._processes]) * self._scale**2
        return (np.maximum(variances - own, 0.0) @ self._basis**2).max(1)

    def _components(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        means, variances = [], []
        for process, inverse in self._processes:  # sklearn solves for each prediction, 5 x as slow for few
            kernel = process.kernel_
            cross = kernel(points, process.X_train_)
            known = ((cross @ inverse) * cross).sum(1)
            means.append(cross @ process.alpha_)
            variances.append(np.maximum(kernel.diag(points) - known, kernel.k2.noise_level))
        return np.stack(means, 1) * self._scale, np.stack(variances, 1) * self._scale**2


def fit_process(points: np.ndarray, values: np.ndarray) -> tuple[Any, np.ndarray]:  # sklearn's kernels have no types
    """Fit a process to values (r,) of unit variance at points (r, d) by maximum likelihood.
    Return it and the inverse (r, r) of its covariance."""
    lengths: Any = np.full(points.shape[1], 0.5)
    kernel = ConstantKernel(1.0, (0.05, 100.0)) * Matern(lengths, LENGTHS, nu=2.5) + WhiteKernel(0.01, (1e-6, 1.0))
    process = GaussianProcessRegressor(kernel, n_restarts_optimizer=1, random_state=0)
    with warnings.catch_warnings():  # a length at its bound is a number that the output does not depend on
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(points, values)
    return process, cho_solve((process.L_, True), np.eye(len(points)))

"""Interquartile means, and bootstrap intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.stats

RESAMPLES, COVERED = 2000, 0.95
"""Resamples of a bootstrap interval, and the share of them that it covers."""


def interquartile_mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the mean of the middle half of values along an axis."""
    return scipy.stats.trim_mean(values, 0.25, axis=axis)


def bootstrap(values: Sequence[float] | np.ndarray, statistic: Any = np.mean) -> tuple[float, float]:
    """Return the ends of the bootstrap interval of a statistic along the last axis, from its percentiles.
    values: of episodes (n,), or of runs with other seeds (runs, n), which are resampled whole."""
    array = np.asarray(values, float)
    by_run = array.ndim == 2 and len(array) > 1
    units = array if by_run else array.reshape(-1, 1)
    if np.ptp(array) == 0.0 or len(units) < 2:
        return (one := float(statistic(array.ravel(), axis=-1))), one
    found = scipy.stats.bootstrap((np.arange(len(units)),), lambda picks, axis: statistic(
        units[picks].reshape(*picks.shape[:-1], -1), axis=-1), n_resamples=RESAMPLES, confidence_level=COVERED,
        method="percentile", vectorized=True, rng=np.random.default_rng(0))
    return float(found.confidence_interval.low), float(found.confidence_interval.high)

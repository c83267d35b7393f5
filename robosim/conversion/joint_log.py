"""What a robot recorded of a motion: joint angles and wrist wrench, and what samples of them are accepted."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError

LEAST_SAMPLES = 10
MOST_GAP = 0.5
"""Longest time [s] between two samples: a joint moves by less than a radian in it."""


class Samples(NamedTuple):
    """Readings over time."""

    times: np.ndarray
    """(n,) [s], increasing."""
    values: np.ndarray
    """(n, k)"""


class JointLog(NamedTuple):
    """What a robot recorded of a motion; its clock starts where it likes."""

    path: Path
    joints: Samples
    """Angles (n, joints) [rad]."""
    wrench: Samples | None
    """Force [N] and torque [N m] (m, 6) of the arm on what hangs at its wrist."""
    wrench_axes: str = "world"
    """"world" or "sensor"."""


def check_times(log: JointLog) -> JointLog:
    """Return a log; raise ConfigError unless its samples are finite, enough, and in order without a gap."""
    for what, samples in (("joint angles", log.joints), ("wrench", log.wrench)):
        if samples is not None:
            _check_samples(log.path, what, samples)
    return log


def _check_samples(path: Path, what: str, samples: Samples) -> None:
    times = samples.times
    if len(times) < LEAST_SAMPLES:
        raise ConfigError(f"{path}: {what}: {len(times)} samples; accepted: at least {LEAST_SAMPLES}")
    if not (np.isfinite(times).all() and np.isfinite(samples.values).all()):
        bad = int(np.flatnonzero(~np.isfinite(np.column_stack(samples)).all(1))[0])
        raise ConfigError(f"{path}: {what}: sample {bad + 1} is not finite; accepted: numbers")
    gaps = np.diff(times)
    for k in np.flatnonzero(~((gaps > 0.0) & (gaps <= MOST_GAP)))[:1]:
        raise ConfigError(f"{path}: {what}: sample {k + 2} comes {gaps[k]:.4g} s after the one before it; accepted: "
                          f"above 0, up to {MOST_GAP} s")

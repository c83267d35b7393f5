"""Poses of a tool one after the other, SAMPLING apart: joined, and rounded so that an arm can follow."""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

SAMPLING = 0.002
"""[s] between poses."""
ROUNDING = 0.08
"""[s] over which a moving average goes, twice."""
JOINING, JOINING_TURN = 0.15, 0.8
"""Speeds [m/s], [rad/s] on the way from the end of a motion to the start of the next."""


def joined(place: np.ndarray, turn: np.ndarray, to: np.ndarray, to_turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The straight way from a pose to another, at constant speed."""
    ends = Rotation.from_quat(np.stack([turn, to_turn]), scalar_first=True)
    angle = float((ends[0].inv() * ends[1]).magnitude())
    n = max(2, round(max(float(np.linalg.norm(to - place)) / JOINING, angle / JOINING_TURN) / SAMPLING))
    share = np.linspace(0.0, 1.0, n)
    return place + share[:, None] * (to - place), Slerp([0.0, 1.0], ends)(share).as_quat(scalar_first=True)


def alike(turns: np.ndarray) -> np.ndarray:
    """The same rotations by quaternions (n, 4) that do not change their sign from one to the next."""
    flips = np.cumprod(np.where(np.sum(turns[1:] * turns[:-1], 1) < 0, -1.0, 1.0))
    return turns * np.concatenate([[1.0], flips])[:, None]


def rounded(values: np.ndarray) -> np.ndarray:
    """A moving average over ROUNDING, twice, of samples (n, k); quaternions are nearly of unit length after it."""
    size = 2 * round(0.5 * ROUNDING / SAMPLING) + 1
    return uniform_filter1d(uniform_filter1d(values, size, axis=0, mode="nearest"), size, axis=0, mode="nearest")

"""Sequences of tool poses at a constant sampling time: connecting and smoothing them."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

SAMPLING = 0.002
"""Time [s] between poses."""
SMOOTHING = 0.08
"""Window [s] of the moving average, which is applied twice."""
CONNECTION_SPEED, CONNECTION_ANGULAR_SPEED = 0.15, 0.8
"""Speeds [m/s], [rad/s] from the end of a motion to the start of the next."""


class PoseSequence(NamedTuple):
    """World poses of the tool's frame, SAMPLING apart."""

    positions: np.ndarray
    """(n, 3) [m]"""
    quaternions: np.ndarray
    """(n, 4), (w, x, y, z)"""


def connect(last: PoseSequence, following: PoseSequence) -> PoseSequence:
    """Connect the end of a sequence to the start of the next.

    The path is straight, its speed constant.
    """
    begin, end = last.positions[-1], following.positions[0]
    rotations = Rotation.from_quat(np.stack([last.quaternions[-1], following.quaternions[0]]), scalar_first=True)
    angle = float((rotations[0].inv() * rotations[1]).magnitude())
    duration = max(float(np.linalg.norm(end - begin)) / CONNECTION_SPEED, angle / CONNECTION_ANGULAR_SPEED)
    share = np.linspace(0.0, 1.0, max(2, round(duration / SAMPLING)))
    return PoseSequence(begin + share[:, None] * (end - begin),
                        Slerp([0.0, 1.0], rotations)(share).as_quat(scalar_first=True))


def align_signs(quaternions: np.ndarray) -> np.ndarray:
    """Align the signs of successive quaternions (n, 4).

    The rotations are the same.
    """
    flips = np.cumprod(np.where(np.sum(quaternions[1:] * quaternions[:-1], 1) < 0, -1.0, 1.0))
    return quaternions * np.concatenate([[1.0], flips])[:, None]


def smooth(values: np.ndarray) -> np.ndarray:
    """Apply a moving average over SMOOTHING twice to samples (n, k).

    Quaternions with aligned signs are nearly of unit length after it.
    """
    size = 2 * round(0.5 * SMOOTHING / SAMPLING) + 1
    return uniform_filter1d(uniform_filter1d(values, size, axis=0, mode="nearest"), size, axis=0, mode="nearest")

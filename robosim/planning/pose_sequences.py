"""Sequences of tool poses at a constant sampling time: connecting, smoothing, and clearing them from containers.

Learning does not include the containers of a rehearsal.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from mpm.geometry.rigid_motion import Pose
from robosim.base.errors import ConfigError
from robosim.config.bounds import MAX_STEPS
from robosim.scene.container_clearance import ContainerSurface

SAMPLING = 0.002
"""Time [s] between poses."""
SMOOTHING = 0.08
"""Window [s] of the moving average, which is applied twice."""
CONNECTION_SPEED, CONNECTION_ANGULAR_SPEED = 0.15, 0.8
"""Speeds [m/s], [rad/s] from the end of a motion to the start of the next."""
CLEARANCE = 0.002
"""Least distance [m] of tool and containers: the largest tracking error that is accepted there."""
MAX_SHIFT = 0.01
"""[m] by which the tool is shifted at most; a path that would need more is left as it is."""
BLEND_TIME = 0.2
"""Time [s] over which a shift begins and ends."""
MAX_ITERATIONS = 8
"""Shifts of a path at most."""
CHECK_STRIDE = 10
"""Samples of the path from one check of the clearance to the next."""
MAX_DURATION = 600.0
"""Duration [s] of a path: 60 000 poses, for each of which the joint angles are solved in a millisecond."""
SHIFT_TOLERANCE = 1e-4
"""Missing clearance [m] that is accepted at the end."""


class PoseSequence(NamedTuple):
    """World poses of the tool's frame, SAMPLING apart."""

    positions: np.ndarray
    """(n, 3) [m]"""
    quaternions: np.ndarray
    """(n, 4), (w, x, y, z)"""


def check_duration(duration: float, host_dt: float, reason: str) -> None:
    """Raise ConfigError for a path of a duration [s] whose points or steps of host_dt [s] are too many to be kept."""
    most = min(MAX_DURATION, MAX_STEPS * host_dt)
    if not duration <= most:
        raise ConfigError(f"the path takes {duration:.4g} s, {duration / host_dt:.3g} steps of host_dt = {host_dt} s: "
                          f"{reason}; accepted: up to {most:g} s in all")


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


def restore_clearance(surface: ContainerSurface, path: PoseSequence) -> np.ndarray:
    """Shift a path away from containers where it comes closer to them than CLEARANCE.

    Returns positions (n, 3) [m]; those of the path where MAX_SHIFT is not enough. Both the path and the smoothed path
    are checked: time scaling gives one between them.
    """
    original, quaternions = path
    smoothed_quaternions, positions = smooth(quaternions), original
    for _ in range(MAX_ITERATIONS):
        shift = compute_shifts(surface, PoseSequence(positions, quaternions))
        smoothed = compute_shifts(surface, PoseSequence(smooth(positions), smoothed_quaternions))
        is_longer = np.linalg.norm(smoothed, axis=1) > np.linalg.norm(shift, axis=1)
        shift[is_longer] = smoothed[is_longer]
        if np.linalg.norm(positions - original, axis=1).max() > MAX_SHIFT:
            break
        if np.linalg.norm(shift, axis=1).max() < SHIFT_TOLERANCE:
            return positions
        positions = positions + blend_shifts(shift)
    return original


def compute_shifts(surface: ContainerSurface, path: PoseSequence) -> np.ndarray:
    """Compute displacements (n, 3) [m] that restore the clearance of a path.

    Zero except at every CHECK_STRIDE-th sample.
    """
    shift = np.zeros_like(path.positions)
    for k in range(0, len(shift), CHECK_STRIDE):
        quaternion = path.quaternions[k] / np.linalg.norm(path.quaternions[k])
        shift[k] = surface.compute_displacement(Pose(path.positions[k], quaternion), CLEARANCE)
    return shift


def blend_shifts(shift: np.ndarray) -> np.ndarray:
    """Blend displacements (n, 3) [m], so that they begin and end smoothly.

    The result is nowhere smaller than `shift`.
    """
    size = 2 * round(0.5 * BLEND_TIME / SAMPLING) + 1
    highest = maximum_filter1d(shift.clip(min=0.0), size, axis=0)
    lowest = minimum_filter1d(shift.clip(max=0.0), size, axis=0)
    return uniform_filter1d(highest + lowest, size, axis=0, mode="nearest")

"""Clearance of a learned path from containers: learning did not include the containers of the rehearsal."""

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from mpm.geometry.rigid_motion import Pose
from robosim.rehearsal.paths.pose_sequences import SAMPLING, PoseSequence, smooth
from robosim.scene.container_clearance import ContainerSurface

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
SHIFT_TOLERANCE = 1e-4
"""Missing clearance [m] that is accepted at the end."""


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

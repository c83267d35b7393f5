"""A learnt motion kept clear of containers: learning knew the one that it scooped from, and none that it pours into."""

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from mpm.geometry.rigid_motion import Pose
from robosim.rehearsal.pose_sequences import SAMPLING, rounded
from robosim.scene.container_clearance import ContainerSurface

CLEAR = 0.002
"""Least distance [m] of tool and containers: as much as the arm may be off its path there."""
FARTHEST = 0.01
"""[m] by which the tool is moved away from a container; what would need more is played as it was learnt."""
EASED = 0.2
"""[s] over which it is moved away, and back."""
ROUNDS, LOOK_EVERY, ENOUGH = 8, 10, 1e-4
"""How often a motion is moved away at most, samples from one look at the containers to the next, and what may be
missing [m] in the end."""


def kept_clear(particles: ContainerSurface, places: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Positions (n, 3) [m] of a tool with quaternions (n, 4), moved away from containers where it came closer to one
    than CLEAR; as they were where that cannot be had within FARTHEST.

    Both the motion itself and the rounded one are looked at: what is played slower is in between.
    """
    averaged, moved = rounded(turns), places
    for _ in range(ROUNDS):
        push, other = pushes(particles, moved, turns), pushes(particles, rounded(moved), averaged)
        longer = np.linalg.norm(other, axis=1) > np.linalg.norm(push, axis=1)
        push[longer] = other[longer]
        if np.linalg.norm(moved - places, axis=1).max() > FARTHEST:
            break
        if np.linalg.norm(push, axis=1).max() < ENOUGH:
            return moved
        moved = moved + eased(push)
    return places


def pushes(particles: ContainerSurface, places: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Displacements (n, 3) [m] of a tool at poses (n, 3), (n, 4) that lead away from the containers."""
    push = np.zeros_like(places)
    for k in range(0, len(places), LOOK_EVERY):
        push[k] = particles.compute_displacement(Pose(places[k], turns[k] / np.linalg.norm(turns[k])), CLEAR)
    return push


def eased(push: np.ndarray) -> np.ndarray:
    """Displacements (n, 3) that begin and end gently, nowhere smaller than those asked for."""
    size = 2 * round(0.5 * EASED / SAMPLING) + 1
    most = maximum_filter1d(push.clip(min=0.0), size, axis=0) + minimum_filter1d(push.clip(max=0.0), size, axis=0)
    return uniform_filter1d(most, size, axis=0, mode="nearest")

"""Which grains are where they may be."""

from collections.abc import Mapping, Sequence

import numpy as np

import mpm
from robosim.recordings.header import RegionEntry


def region_pose(region: RegionEntry, bodies: Mapping[str, mpm.Pose]) -> mpm.Pose:
    """Return the world pose of a region's frame; bodies: name -> world pose."""
    own = mpm.Pose(np.array(region.position), np.array(region.quaternion))
    return bodies[region.body] @ own if region.body in bodies else own


def find_placed(regions: Sequence[RegionEntry], bodies: Mapping[str, mpm.Pose], positions: np.ndarray) -> np.ndarray:
    """Return which grains at positions (n, 3) [m] lie in one of the regions that are places (n,)."""
    left = np.arange(len(positions))
    """Grains that are in none of the regions so far: most lie in the first."""
    for region in regions:
        if region.is_place:
            box = mpm.Region((0.0, 0.0, 0.0), region.half, region.round)
            left = left[~box.holds(region_pose(region, bodies).inverse().apply(positions[left]))]
    placed = np.ones(len(positions), bool)
    placed[left] = False
    return placed

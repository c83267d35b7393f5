"""The region of a container in which its grains are counted."""

import mpm
from robosim.config.scene import ContainerConfig
from robosim.scene.frames import container_pose
from robosim.scene.grains import RIM_MARGIN
from robosim.scene.models import read_inner_size

WALL_MARGIN, FLOOR_MARGIN = 1e-3, 5e-3
"""Distances [m] beyond the inner walls, and below the floor, up to which grains count as in it."""


def container_region(name: str, container: ContainerConfig) -> tuple[mpm.Region, mpm.Pose]:
    """Return the region in the container's frame, as `robosim.scene.grains.is_in_container` counts, and its pose."""
    x, y, z = map(float, read_inner_size(name))
    top = z + RIM_MARGIN
    half = (x / 2.0 + WALL_MARGIN, y / 2.0 + WALL_MARGIN, (top + FLOOR_MARGIN) / 2.0)
    return mpm.Region((0.0, 0.0, (top - FLOOR_MARGIN) / 2.0), half), container_pose(container)

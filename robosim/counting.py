"""Where the grains are: in the tool, in a container, spilled."""

import numpy as np

from mpm import Grid, Pose
from robosim.config import ContainerConfig
from robosim.frames import container_pose

RIM_MARGIN = 0.02
"""Height [m] above a container's rim up to which grains count as in it."""
BORDER = 1e-6
"""Distance [m] from the region's border within which a grain counts as stopped by it."""
HEAP = 0.04
"""Height [m] above the bowl's rim plane up to which a heap counts as in the spoon."""
BOWL = np.array([0.035, 0.025, 0.030])
"""Semi-axes [m] of the spoon's bowl."""
OVERHANG = 3.0
"""Squared radius, in those of the rim's ellipse, within which grains count: the thickened wall's rim carries some, and
cohesive heaps overhang it. Once the spoon is in the air nothing else is there."""


def in_spoon(positions: np.ndarray, tool_pose: Pose) -> np.ndarray:
    """Whether grains at positions [m] (n, 3) lie in the bowl or in the heap on it (n,)."""
    y = tool_pose.inverse().apply(positions)
    ellipse = (y[:, 0] / BOWL[0]) ** 2 + (y[:, 1] / BOWL[1]) ** 2
    return (ellipse < OVERHANG) & (y[:, 2] > -1.05 * BOWL[2]) & (y[:, 2] < HEAP)


def in_container(positions: np.ndarray, container: ContainerConfig, inner_size: np.ndarray) -> np.ndarray:
    """Whether grains lie between a container's walls (n,)."""
    y = container_pose(container).inverse().apply(positions)
    half = inner_size[:2] / 2.0 + 1e-3
    return np.all(np.abs(y[:, :2]) < half, axis=1) & (y[:, 2] < inner_size[2] + RIM_MARGIN) & (y[:, 2] > -5e-3)


def at_the_border(positions: np.ndarray, grid: Grid) -> np.ndarray:
    """Whether grains touch the sides or the top of the region, or are not finite (n,)."""
    lower, upper = np.asarray(grid.lower) + BORDER, np.asarray(grid.lower) + grid.cells * grid.cell - BORDER
    inside = np.all((positions[:, :2] > lower[:2]) & (positions[:, :2] < upper[:2]), axis=1)
    return ~(inside & (positions[:, 2] < upper[2]))

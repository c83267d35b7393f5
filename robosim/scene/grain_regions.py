"""Which grains are in the tool, in a container, or at the border of the field's region."""

import numpy as np

from mpm import Grid, Pose
from robosim.config.scene import ContainerConfig
from robosim.scene.frames import container_pose
from robosim.shapes import tool_shape

RIM_MARGIN = 0.02
"""Height [m] above a container's rim up to which grains count as in it."""
BORDER = 1e-6
"""Distance [m] from the region's border within which a grain counts as stopped by it."""


def is_in_tool(tool: str, positions: np.ndarray, tool_pose: Pose) -> np.ndarray:
    """Test which grains lie in a tool or in the heap on it.

    positions [m] (n, 3). Returns (n,) bool.
    """
    return tool_shape(tool).interior.holds(tool_pose.inverse().apply(positions))


def is_in_container(positions: np.ndarray, container: ContainerConfig, inner_size: np.ndarray) -> np.ndarray:
    """Test which grains lie between a container's walls.

    positions [m] (n, 3), inner_size [m] (3,). Returns (n,) bool.
    """
    local = container_pose(container).inverse().apply(positions)
    half = inner_size[:2] / 2.0 + 1e-3
    between_walls = np.all(np.abs(local[:, :2]) < half, axis=1)
    return between_walls & (local[:, 2] < inner_size[2] + RIM_MARGIN) & (local[:, 2] > -5e-3)


def is_at_border(positions: np.ndarray, grid: Grid) -> np.ndarray:
    """Test which grains touch the sides or the top of the grid, or are not finite.

    positions [m] (n, 3). Returns (n,) bool.
    """
    lower, upper = np.asarray(grid.lower) + BORDER, np.asarray(grid.lower) + grid.cells * grid.cell - BORDER
    inside = np.all((positions[:, :2] > lower[:2]) & (positions[:, :2] < upper[:2]), axis=1)
    return ~(inside & (positions[:, 2] < upper[2]))

"""Grains of a scene: initial positions, and those in a tool, in a container or at the border."""

from collections.abc import Mapping

import numpy as np

import mpm
from mpm.geometry.sampled_sdf import Lattice
from mpm.geometry.shape import Shape
from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.scene import ContainerConfig
from robosim.scene.frames import container_pose
from robosim.scene.models import container_shape
from robosim.shapes import OwnTool, tool_shape

BURIED = 0.24
"""Depth in a wall, in distances between grains, from which a grain is left out, before the field warns of it."""
BORDER = 1e-6
"""Distance [m] from the region's border within which a grain counts as stopped by it."""


def fill(config: RehearsalConfig, sdf: Lattice, walls: Mapping[str, Shape], tool_pose: mpm.Pose,
         rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Fill the source container, the pile or the tool with grains, before they settle.

    sdf: the tool's signed distance in its own frame. walls: those of containers in theirs. Returns positions [m] (n, 3)
    and the volume [m^3] of one grain.
    Raises ConfigError where tool_fill_height is too small for any grain.
    """
    spacing = config.field.cell / config.field.grains_per_cell ** (1.0 / 3.0)
    if config.sources:
        places, total = [], 0.0
        for name in config.sources:
            container = config.containers[name]
            local, volume = container_shape(name, container).fill(container.fill_height, spacing, rng)
            local = leave_out_buried(local, walls[name], spacing)
            if not len(local):
                raise ConfigError(f"containers.{name}: fill_height = {container.fill_height} m holds no grain; "
                                  f"accepted: more than a cell, {config.field.cell} m")
            places.append(container_pose(container).apply(local))
            total += len(local) * volume
        return np.concatenate(places), total / sum(map(len, places))
    if config.pile is not None:
        centre, half = np.array(config.pile.centre), np.array(config.pile.half)
        positions = mpm.sample_box(centre - half, centre + half, spacing, rng)
        return positions, float(8.0 * np.prod(half)) / len(positions)
    region = tool_shape(config.tool).interior
    local = sample_in_tool(config.tool, sdf, spacing, rng)
    local = local[local[:, 2] < region.centre[2] - region.half[2] + (config.tool_fill_height or 0.0)]
    if not len(local):
        raise ConfigError(f"tool_fill_height = {config.tool_fill_height} m holds no grain; accepted: more than a cell, "
                          f"{config.field.cell} m")
    return tool_pose.apply(local), spacing**3


def leave_out_buried(positions: np.ndarray, walls: Shape, spacing: float) -> np.ndarray:
    """Return those of positions [m] (n, 3), `spacing` [m] apart, that do not lie deep in walls in whose frame they are.

    The inside of a mesh is known by cells, which reach into its walls by up to half a cell.
    """
    return positions[walls.distance(positions) > -BURIED * spacing]


def sample_in_tool(tool: str | OwnTool, sdf: Lattice, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Sample positions [m] (n, 3) in the tool's frame where it supports grains.

    They fill its interior and as much height again above it, about `spacing` [m] apart.
    """
    region = tool_shape(tool).interior
    centre, half = np.array(region.centre), np.array(region.half)
    local = mpm.sample_box(centre - half, centre + half * [1, 1, 2], spacing, rng)
    if tool_shape(tool).holes is not None:  # nothing is placed on its cap
        local = local[region.holds(local)]
    return local[(sdf.distance(local) > 0.5 * spacing) & _is_above_tool(local, sdf, spacing)]


def _is_above_tool(points: np.ndarray, sdf: Lattice, spacing: float) -> np.ndarray:
    """Test whether the tool lies below points (n, 3) in its frame: grains at others would fall past it."""
    result = np.zeros(len(points), bool)
    for drop in np.arange(spacing, 0.1, spacing / 2):
        result |= sdf.distance(points - [0.0, 0.0, drop]) < 0.0
    return result


def is_in_tool(tool: str | OwnTool, positions: np.ndarray, tool_pose: mpm.Pose) -> np.ndarray:
    """Test which grains lie in a tool or in the heap on it.

    positions [m] (n, 3). Returns (n,) bool.
    """
    return tool_shape(tool).interior.holds(tool_pose.inverse().apply(positions))


def is_in_container(positions: np.ndarray, name: str, container: ContainerConfig) -> np.ndarray:
    """Test which grains lie between a container's walls.

    positions [m] (n, 3). Returns (n,) bool.
    """
    return container_shape(name, container).holds(container_pose(container).inverse().apply(positions))


def is_at_border(positions: np.ndarray, grid: mpm.Grid) -> np.ndarray:
    """Test which grains touch the sides or the top of the grid, or are not finite.

    positions [m] (n, 3). Returns (n,) bool.
    """
    lower, upper = np.asarray(grid.lower) + BORDER, np.asarray(grid.lower) + grid.cells * grid.cell - BORDER
    x, y, z = np.ascontiguousarray(positions.T)  # a column at a time: a fifth of the time
    return ~((x > lower[0]) & (x < upper[0]) & (y > lower[1]) & (y < upper[1]) & (z < upper[2]))


def container_region(name: str, container: ContainerConfig) -> tuple[mpm.Region, mpm.Pose]:
    """Return the region around what `is_in_container` counts, in the container's frame, and the pose of that frame."""
    return container_shape(name, container).region, container_pose(container)

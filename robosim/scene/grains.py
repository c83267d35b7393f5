"""Grains of a scene: initial positions, and those in a tool, in a container or at the border."""

from typing import NamedTuple

import numpy as np

import mpm
from mpm.geometry.sampled_sdf import Lattice
from mpm.geometry.shape import Shape
from robosim.base.errors import ConfigError
from robosim.config.scene import ContainerConfig
from robosim.config.scene_config import SceneConfig
from robosim.config.tool import ToolConfig
from robosim.scene.models import container_shape
from robosim.shapes import tool_shape
from robosim.shapes.containers import BoxShape, ContainerShape

CONTAINER_SPACING = 2e-3
"""Lattice spacing [m] of a container's signed distance."""
CONTAINER_WALL = 3.0
"""Thickness of a container's collider walls, in cells, grown outward."""
BURIED = 0.24
"""Depth in a wall, in distances between grains, from which a grain is left out, before the field warns of it."""
BORDER = 1e-6
"""Distance [m] from the region's border within which a grain counts as stopped by it."""


class Filling(NamedTuple):
    """Grains of a scene before they settle."""

    positions: np.ndarray
    """In the world [m] (n, 3)."""
    volume: float
    """Of one grain [m^3]."""


def fill(scene: SceneConfig, tool: Lattice, tool_pose: mpm.Pose, seed: int = 0, slope_deg: float = 0.0) -> Filling:
    """Fill the filled containers, the pile or the tool with grains, before they settle.

    tool: its signed distance in its own frame. Where the scene says how many grains there are, they take the lowest
    places, under a surface with a slope along the x axis of container or pile; otherwise all is filled up to its
    height, with as many grains in a cell as the scene says. Raises ConfigError for a height in which no grain fits,
    mpm.InvalidValue where a number of grains does not fit."""
    rng, count, slope = np.random.default_rng(seed), scene.grain_count, float(np.tan(np.radians(slope_deg)))
    volume = 0.0 if count is None else grain_volume(scene)
    spacing = scene.field.cell / scene.field.grains_per_cell ** (1.0 / 3.0) if count is None else volume ** (1.0 / 3.0)
    if scene.sources and count is None:
        return _fill_containers(scene, spacing, rng)
    if scene.sources:
        name = scene.sources[0]
        container = scene.containers[name]
        shape = container_shape(name, container)
        low, high = shape.bounds
        rise = 0.5 * abs(slope) * (high[0] - low[0])
        upper = np.array([high[0], high[1], low[2] + container.fill_height + rise + spacing])
        local = mpm.sample_box(low, upper, spacing, rng)
        if not isinstance(shape, BoxShape):  # the rounded edges of a box push out the few grains in them
            local = local[shape.between_walls(local)]
        places = container.pose.apply(local)
        keys = places[:, 2] - slope * (local[:, 0] - 0.5 * (low[0] + high[0]))
    elif scene.pile is not None:
        centre, half = np.array(scene.pile.centre), np.array(scene.pile.half)
        places = mpm.sample_box(centre - half, centre + half * [1, 1, 1 if count is None else 2], spacing, rng)
        if count is None:
            return Filling(places, float(8.0 * np.prod(half)) / len(places))
        keys = places[:, 2] + 0.3 * np.linalg.norm(places[:, :2] - centre[:2], axis=1)  # a heap, not a slab
        keys -= slope * (places[:, 0] - centre[0])
    else:
        region = tool_shape(scene.tool).interior
        local = sample_in_tool(scene.tool, tool, spacing, rng)
        if count is None:
            local = local[local[:, 2] < region.centre[2] - region.half[2] + (scene.tool_fill_height or 0.0)]
            if not len(local):
                raise ConfigError(f"tool_fill_height = {scene.tool_fill_height} m holds no grain; accepted: more than "
                                  f"a cell, {scene.field.cell} m")
            return Filling(tool_pose.apply(local), spacing**3)
        places = tool_pose.apply(local)
        keys = places[:, 2] + 0.6 * np.linalg.norm(local[:, :2] - np.array(region.centre)[:2], axis=1)
    assert count is not None
    if len(places) < count:
        raise mpm.InvalidValue(f"{count} grains of {volume * 1e9:.0f} mm^3 do not fit: {len(places)} places; accepted: "
                               f"at most that many grains.count")
    return Filling(places[np.argsort(keys, kind="stable")[:count]], volume)


def _fill_containers(scene: SceneConfig, spacing: float, rng: np.random.Generator) -> Filling:
    """Fill all filled containers up to their heights, with grains `spacing` [m] apart."""
    places, total = [], 0.0
    for name in scene.sources:
        container = scene.containers[name]
        shape = container_shape(name, container)
        local, volume = fill_container(shape, container.fill_height, spacing, scene.field.cell, rng)
        if not len(local):
            raise ConfigError(f"containers.{name}: fill_height = {container.fill_height} m holds no grain; "
                              f"accepted: more than a cell, {scene.field.cell} m")
        places.append(container.pose.apply(local))
        total += len(local) * volume
    return Filling(np.concatenate(places), total / sum(map(len, places)))


def grain_volume(scene: SceneConfig) -> float:
    """Return the volume of one grain [m^3] of a scene."""
    if scene.grain_count is None:
        return scene.field.cell**3 / scene.field.grains_per_cell
    for name in scene.sources:
        container = scene.containers[name]
        return container_shape(name, container).filled_volume(container.fill_height) / scene.grain_count
    if scene.pile is not None:
        return 8.0 * float(np.prod(scene.pile.half)) / scene.grain_count
    return scene.field.cell**3 / scene.field.grains_per_cell


def grain_volume_of(solver: mpm.Solver) -> float:
    """Return the volume of one grain [m^3] in the solver of a scene."""
    return np.asarray(solver.bodies[0].volume, float).item()


def fill_container(shape: ContainerShape, height: float, spacing: float, cell: float,
                   rng: np.random.Generator) -> Filling:
    """Fill a container up to a height [m] above its floor, in its own frame, but for what lies deep in its walls.
    spacing: between grains [m]. cell: of the field [m], from which the thickness of the collider's walls follows."""
    local, volume = shape.fill(height, spacing, rng)
    return Filling(leave_out_buried(local, shape.distance(CONTAINER_WALL * cell, CONTAINER_SPACING), spacing), volume)


def leave_out_buried(positions: np.ndarray, walls: Shape, spacing: float) -> np.ndarray:
    """Return those of positions [m] (n, 3), `spacing` [m] apart, that do not lie deep in walls in whose frame they are.
    The inside of a mesh is known by cells, which reach into its walls by up to half a cell."""
    return positions[walls.distance(positions) > -BURIED * spacing]


def sample_in_tool(tool: str | ToolConfig, sdf: Lattice, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Sample positions [m] (n, 3) in the tool's frame, `spacing` [m] apart: its interior and as much height above."""
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


def is_in_tool(tool: str | ToolConfig, positions: np.ndarray, tool_pose: mpm.Pose) -> np.ndarray:
    """Test which positions [m] (n, 3) lie in a tool or in the heap on it (n,)."""
    return tool_shape(tool).interior.holds(tool_pose.inverse().apply(positions))


def is_in_container(positions: np.ndarray, name: str, container: ContainerConfig) -> np.ndarray:
    """Test which positions [m] (n, 3) lie between a container's walls (n,)."""
    return container_shape(name, container).holds(container.pose.inverse().apply(positions))


def is_at_border(positions: np.ndarray, grid: mpm.Grid) -> np.ndarray:
    """Test which positions [m] (n, 3) touch the sides or the top of the grid, or are not finite (n,)."""
    lower, upper = np.asarray(grid.lower) + BORDER, np.asarray(grid.lower) + grid.cells * grid.cell - BORDER
    x, y, z = np.ascontiguousarray(positions.T)  # a column at a time: a fifth of the time
    return ~((x > lower[0]) & (x < upper[0]) & (y > lower[1]) & (y < upper[1]) & (z < upper[2]))


def container_region(name: str, container: ContainerConfig) -> tuple[mpm.Region, mpm.Pose]:
    """Return the region around what `is_in_container` counts, in the container's frame, and the pose of that frame."""
    return container_shape(name, container).region, container.pose

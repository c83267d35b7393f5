"""Heights on a raster, as a depth sensor above the scene gives them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import mpm
from mpm.observers.height_map import HeightMap, Raster
from robosim.base.errors import ConfigError
from robosim.config.scene import ContainerConfig
from robosim.scene.grains import grain_volume
from robosim.scene.models import container_shape
from robosim.senses.term import NOTHING, SenseScene, Sight, Term, box, check_count
from robosim.shapes import tool_shape
from robosim.tasks.draw import HOME
from robosim.tasks.task import TaskConfig

MOST_PIXELS = 512
"""Along an edge."""
FINER = 4.0
"""Pixels of a container's own raster along one of the picture's."""
MARGIN = 0.02
"""Distance [m] that the raster shows around what it is about."""


class HeightMapTerm(Term):
    """Heights [m] of grains, container and table, without tool and arm, on a raster that is seen from straight above.

    lower, upper [m] (2,): corners of the region; without them, 20 mm around the container, or around the places where
    the grains begin and shall end. pixels: along x and y."""

    name, unit = "height_map", "m"
    all_grains = True

    def __init__(self, scene: SenseScene, lower: Sequence[float] | None = None, upper: Sequence[float] | None = None,
                 pixels: Sequence[int] = (64, 64)) -> None:
        own = default_region(scene.task)
        corners = [np.asarray(given if given is not None else standard, float)
                   for given, standard in zip((lower, upper), own)]
        if any(corner.shape != (2,) or not np.isfinite(corner).all() for corner in corners) or \
                not (corners[0] < corners[1]).all() or np.shape(pixels) != (2,):
            raise ConfigError(f"obs: height_map: lower = {lower}, upper = {upper}, pixels = {pixels}; accepted: two "
                              f"corners (x, y) in metres, the first one below the second, and two numbers")
        nx, ny = (check_count("height_map", "pixels", count, MOST_PIXELS) for count in pixels)
        (x0, y0), (x1, y1) = corners
        self._raster = raster = Raster((float(x0), float(y0)), (float(x1), float(y1)), (nx, ny))
        self._task = scene.task
        self._map = HeightMap(raster, grain_volume(scene.task) ** (1 / 3))
        self._floor, self._floor_at = floor_heights(scene.task, raster), PlacedFloor(scene.task, raster)
        top = float(np.asarray(scene.solver.grid.lower)[2] + scene.solver.grid.cells[2] * scene.solver.grid.cell) + 0.05
        self.space = box(np.full((nx, ny), min(0.0, float(self._floor.min()))), np.full((nx, ny), top))

    def begin(self, sight: Sight, drawn: Mapping[str, float] = NOTHING) -> Any:
        """Return the heights of table and container, where it stands elsewhere than in the task."""
        place = sight.setting.place
        return None if place is HOME or not self._task.containers else self._floor_at.heights(place)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the heights (nx, ny), the first index along x."""
        floor = self._floor if memory is None else memory
        return np.clip(self._map.draw(sight.grains, floor), self.space.low, self.space.high)


def default_region(task: TaskConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners [m] (2,) of the region around a task's container, or else its start and its target."""
    for name, container in task.containers.items():
        walls = container_shape(name, container).walls().vertices
        corners = container.pose.apply(np.asarray(walls))[:, :2]
        return corners.min(0) - MARGIN, corners.max(0) + MARGIN
    centre, half = np.array(task.target.centre)[:2], np.minimum(np.array(task.target.half)[:2], 0.5)
    start, own = np.array(task.start.position)[:2], np.linalg.norm(tool_shape(task.tool).interior.half[:2])
    if task.pile is not None:
        start, own = np.array(task.pile.centre)[:2], np.array(task.pile.half)[:2]
    return np.minimum(centre - half, start - own) - MARGIN, np.maximum(centre + half, start + own) + MARGIN


def floor_heights(task: TaskConfig, raster: Raster) -> np.ndarray:
    """Return the heights [m] (nx, ny), float32, of table and container without grains."""
    heights = np.zeros(raster.shape, np.float32)
    for name, container in task.containers.items():
        draw_from_above(wall_triangles(name, container, container.pose), raster, heights)
    return heights


def wall_triangles(name: str, container: ContainerConfig, pose: mpm.Pose) -> np.ndarray:
    """Return the triangles [m] (n, 3, 3) of a container's walls at a pose."""
    return pose.apply(np.asarray(container_shape(name, container).walls().triangles).reshape(-1, 3)).reshape(-1, 3, 3)


class PlacedFloor:
    """Heights of table and container where an episode has it, looked up in rasters of the container's own frame."""

    def __init__(self, task: TaskConfig, raster: Raster) -> None:
        lower, shape = np.array(raster.lower), np.array(raster.shape)
        pixel = (np.array(raster.upper) - lower) / shape
        x, y = (lower[k] + pixel[k] * (np.arange(shape[k]) + 0.5) for k in range(2))
        self._points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros(raster.shape)], axis=-1).reshape(-1, 3)
        self._shape, self._fine, self._task = raster.shape, float(pixel.min()) / FINER, task
        self._seen: list[tuple[mpm.Pose, np.ndarray, np.ndarray]] | None = None

    def heights(self, place: mpm.Pose) -> np.ndarray:
        """Return the heights [m] (nx, ny), float32, with the containers displaced."""
        heights = np.zeros(len(self._points), np.float32)
        if self._seen is None:
            self._seen = [self._look_at(name, container) for name, container in self._task.containers.items()]
        for home, corner, own in self._seen:
            pose = place @ home
            flat = pose.inverse().apply(self._points)[:, :2]
            index = np.floor((flat - corner) / self._fine).astype(int)
            inside = np.flatnonzero(((index >= 0) & (index < own.shape)).all(1))
            heights[inside] = np.maximum(heights[inside], own[tuple(index[inside].T)] + pose.position[2])
        return heights.reshape(self._shape)

    def _look_at(self, name: str, container: ContainerConfig) -> tuple[mpm.Pose, np.ndarray, np.ndarray]:
        """Return a frame at a container with a vertical z axis, the corner of a raster in it, and its heights."""
        home = container.pose
        upright = mpm.Pose(home.position, mpm.Pose.identity().quaternion)
        local = wall_triangles(name, container, upright.inverse() @ home)
        low, high = local[..., :2].min((0, 1)), local[..., :2].max((0, 1))
        shape = np.ceil((high - low) / self._fine).astype(int)
        own = np.full(tuple(shape), -np.inf, np.float32)
        (x0, y0), (x1, y1), (nx, ny) = low.tolist(), (low + self._fine * shape).tolist(), shape.tolist()
        draw_from_above(local, Raster((x0, y0), (x1, y1), (nx, ny)), own)
        return upright, low, own


def draw_from_above(triangles: np.ndarray, raster: Raster, heights: np.ndarray) -> None:
    """Raise heights [m] (nx, ny) to those of triangles [m] (n, 3, 3), where they are higher."""
    lower, shape = np.array(raster.lower), np.array(raster.shape)
    pixel = (np.array(raster.upper) - lower) / shape
    for triangle in triangles:
        flat = (triangle[:, :2] - lower) / pixel - 0.5
        first = np.maximum(np.ceil(flat.min(0)), 0).astype(int)
        last = np.minimum(np.floor(flat.max(0)), shape - 1).astype(int)
        (ax, ay), (bx, by), (cx, cy) = flat
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12 or (first > last).any():
            continue
        x, y = np.meshgrid(*[np.arange(f, l + 1) for f, l in zip(first, last)], indexing="ij")
        b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
        c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
        z = triangle[0, 2] + b * (triangle[1, 2] - triangle[0, 2]) + c * (triangle[2, 2] - triangle[0, 2])
        inside = (b >= 0) & (c >= 0) & (b + c <= 1)
        view = heights[first[0] : last[0] + 1, first[1] : last[1] + 1]
        view[inside] = np.maximum(view, z)[inside]

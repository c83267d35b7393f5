"""Heights of the particles' upper surface on a horizontal raster, as a sensor that looks straight down sees them."""

from typing import NamedTuple

import numpy as np

from mpm.backend import default_precision, is_shared, session_precision, ti
from mpm.backend.launching import Launcher
from mpm.errors import InvalidValue

RADIUS = 0.75**0.5
"""Radius of a particle's sphere in spacings: half the diagonal of its cube, so that a flat lattice has no holes."""
SINK = 0.2607
"""Spacings by which spheres are lowered, so that the mean height of a flat lattice is that of its cubes' upper faces:
the mean of sqrt(RADIUS^2 - x^2 - y^2) over a unit square, 0.7607, less half a spacing."""


class Raster(NamedTuple):
    """A region of the horizontal plane, divided into equal pixels."""

    lower: tuple[float, float]
    """Corner with the least x and y [m]."""
    upper: tuple[float, float]
    """The opposite corner [m]."""
    shape: tuple[int, int]
    """Pixels along x and along y."""


@ti.data_oriented
class HeightMap:
    """Draws particles as overlapping spheres and keeps the highest point of each pixel's centre.
    spacing: side [m] of the particles' cubes, the cube root of their volume. Raises InvalidValue for a raster without
    pixels or area, and for a spacing that is not positive."""

    def __init__(self, raster: Raster, spacing: float) -> None:
        lower, upper = np.array(raster.lower, float), np.array(raster.upper, float)
        if min(raster.shape) < 1 or not (lower < upper).all() or not spacing > 0.0:
            raise InvalidValue(f"HeightMap: {raster}, spacing = {spacing}; accepted: one pixel or more along x and y, "
                               f"lower below upper, a positive spacing")
        session_precision()  # starts the backend
        self.shape, self.on_gpu = raster.shape, is_shared()
        self._scale = np.array([*lower, *((upper - lower) / raster.shape), spacing], np.float32)
        self._launch = Launcher(self, HeightMap._draw)

    def draw(self, positions: np.ndarray, floor: np.ndarray) -> np.ndarray:
        """Return the heights [m] (nx, ny), float32, of particles at positions [m] (n, 3 or more), float32.
        floor (nx, ny), float32: heights [m] without particles; the result is never below them."""
        heights = floor.copy()
        with default_precision("f32"):
            self._launch(positions, self._scale, heights)
        return heights

    @ti.kernel
    def _draw(self, positions: ti.types.ndarray(), scale: ti.types.ndarray(), heights: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for i in range(positions.shape[0]):
            spacing = scale[4]
            radius = ti.static(RADIUS) * spacing
            x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
            first = [ti.max(0, ti.cast(ti.ceil(((x, y)[d] - radius - scale[d]) / scale[2 + d] - 0.5), ti.i32))
                     for d in ti.static(range(2))]
            last = [ti.min(ti.static(self.shape)[d] - 1,
                           ti.cast(ti.floor(((x, y)[d] + radius - scale[d]) / scale[2 + d] - 0.5), ti.i32))
                    for d in ti.static(range(2))]
            for j in range(first[0], last[0] + 1):
                dx = scale[0] + (ti.cast(j, ti.f32) + 0.5) * scale[2] - x
                for k in range(first[1], last[1] + 1):
                    dy = scale[1] + (ti.cast(k, ti.f32) + 0.5) * scale[3] - y
                    rest = radius * radius - dx * dx - dy * dy
                    if rest > 0.0:
                        ti.atomic_max(heights[j, k], z + ti.sqrt(rest) - ti.static(SINK) * spacing)

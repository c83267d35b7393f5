"""Signed distance of ground that is given by heights."""

import numpy as np

from mpm.backend import ti
from mpm.errors import InvalidValue
from mpm.geometry.sampled_sdf import Sampled
from mpm.geometry.shape import check_sizes


class HeightField(Sampled):
    """Ground below heights [m] (rows along y, columns along x) over |x| <= half[0], |y| <= half[1]; 1 m outside.
    Bilinear between its points; distances are of first order, exact at the surface."""

    def __init__(self, heights: np.ndarray, half: tuple[float, float]) -> None:
        self.host = np.asarray(heights, np.float32)
        self.half = check_sizes("Sdf.height_field", "half", half, 2)
        if self.host.ndim != 2 or min(self.host.shape) < 2 or not np.isfinite(self.host).all():
            raise InvalidValue(f"Sdf.height_field: heights have shape {self.host.shape}; accepted: (rows, columns), "
                               f"2 or more of each, finite numbers")
        rows, columns = self.host.shape
        self.spacing = (2.0 * self.half[0] / (columns - 1), 2.0 * self.half[1] / (rows - 1))
        self.radius = float(np.linalg.norm([*self.half, np.abs(self.host).max()]))

    @ti.func
    def at(self, y):
        u, w = (y[0] + self.half[0]) / self.spacing[0], (y[1] + self.half[1]) / self.spacing[1]
        n = 0.0 * y
        phi = 0.0 * y[0] + 1.0
        rows, columns = ti.static(self.host.shape[0] - 1), ti.static(self.host.shape[1] - 1)
        if u >= 0 and w >= 0 and u <= columns and w <= rows:
            i, j = ti.min(ti.cast(u, ti.i32), columns - 1), ti.min(ti.cast(w, ti.i32), rows - 1)
            f, g = u - i, w - j
            low = self.values[j, i] + f * (self.values[j, i + 1] - self.values[j, i])
            high = self.values[j + 1, i] + f * (self.values[j + 1, i + 1] - self.values[j + 1, i])
            n[0] = -((1 - g) * (self.values[j, i + 1] - self.values[j, i])
                     + g * (self.values[j + 1, i + 1] - self.values[j + 1, i])) / self.spacing[0]
            n[1] = -(high - low) / self.spacing[1]
            n[2] = n[2] + 1.0
            steep = n.norm()
            n = n / steep
            phi = (y[2] - low - g * (high - low)) / steep
        return n, phi

    def distance(self, points: np.ndarray) -> np.ndarray:
        inside = np.all(np.abs(points[..., :2]) <= self.half, axis=-1)
        u, w = ((np.clip(points[..., d], -self.half[d], self.half[d]) + self.half[d]) / self.spacing[d] for d in (0, 1))
        i = np.minimum(u.astype(int), self.host.shape[1] - 2)
        j = np.minimum(w.astype(int), self.host.shape[0] - 2)
        corners = [[self.host[j + b, i + a].astype(float) for a in (0, 1)] for b in (0, 1)]
        low, high = (row[0] + (u - i) * (row[1] - row[0]) for row in corners)
        across = ((1 - w + j) * (corners[0][1] - corners[0][0]) + (w - j) * (corners[1][1] - corners[1][0]))
        steep = np.sqrt(1.0 + (across / self.spacing[0]) ** 2 + ((high - low) / self.spacing[1]) ** 2)
        return np.where(inside, (points[..., 2] - low - (w - j) * (high - low)) / steep, 1.0)

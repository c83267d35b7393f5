"""Signed distance of analytic solids: negative inside, in metres."""

import numpy as np

from mpm.backend import ti
from mpm.errors import InvalidValue
from mpm.geometry.shape import ExactShape, Shape, check_sizes

NEAR = 1e-6  # [m] from a face within which rounding decides on which side a point is


class Plane(ExactShape):
    """The half space below a plane through the frame's origin; the normal [-] (3,) points out of the solid."""

    radius = 1e6

    def __init__(self, normal: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> None:
        length = float(np.linalg.norm(normal)) if np.shape(normal) == (3,) else 0.0
        if not 0.0 < length < np.inf:
            raise InvalidValue(f"Sdf.plane: normal = {normal}; accepted: three finite numbers, not all zero")
        self.normal = tuple(float(c) for c in np.asarray(normal) / length)

    @ti.func
    def at(self, y):
        n = ti.Vector([self.normal[0], self.normal[1], self.normal[2]])
        return n, y.dot(n)

    @ti.func
    def at_back(self, y, normal_bar, phi_bar, real: ti.template()):
        return ti.Vector([self.normal[0], self.normal[1], self.normal[2]]) * phi_bar

    def distance(self, points: np.ndarray) -> np.ndarray:
        return points @ np.asarray(self.normal)


class Sphere(ExactShape):
    """A ball of radius r [m] about the frame's origin."""

    def __init__(self, r: float) -> None:
        self.r, = check_sizes("Sdf.sphere", "r", r)
        self.radius, self.thinnest = self.r, 2.0 * self.r

    @ti.func
    def at(self, y):
        distance = y.norm(1e-12)
        return y / distance, distance - self.r

    def distance(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points, axis=-1) - self.r


class Capsule(ExactShape):
    """Points within r [m] of the segment of half length h [m] along the frame's z axis."""

    def __init__(self, r: float, h: float) -> None:
        self.r, = check_sizes("Sdf.capsule", "r", r)
        self.h, = check_sizes("Sdf.capsule", "h", h, least=-1e-300)
        self.radius, self.thinnest = self.r + self.h, 2.0 * self.r

    @ti.func
    def at(self, y):
        rest = y
        rest[2] = y[2] - ti.math.clamp(y[2], -self.h, self.h)
        distance = rest.norm(1e-12)
        return rest / distance, distance - self.r

    def distance(self, points: np.ndarray) -> np.ndarray:
        rest = points - np.clip(points[..., 2:], -self.h, self.h) * [0.0, 0.0, 1.0]
        return np.linalg.norm(rest, axis=-1) - self.r


class Box(ExactShape):
    """A box of half sizes [m] (3,) about the frame's origin."""

    def __init__(self, half: tuple[float, float, float]) -> None:
        self.half = check_sizes("Sdf.box", "half", half, 3)
        self.radius, self.thinnest = float(np.linalg.norm(self.half)), 2.0 * min(self.half)

    @ti.func
    def at(self, y):
        # inside, the nearest face decides; outside, the offset from the nearest surface point
        out = ti.Vector([ti.abs(y[d]) - self.half[d] for d in ti.static(range(3))])
        side = ti.Vector([ti.select(y[d] < 0, -1.0, 1.0) for d in ti.static(range(3))])
        deepest = out.max()
        n = side * 0.0
        phi = deepest
        if deepest < NEAR:  # at the surface too, where the offset from the nearest point has no direction
            for d in ti.static(range(3)):
                if out[d] == deepest:
                    n = side * 0.0
                    n[d] = side[d]
        else:
            away = ti.max(out, 0.0)
            phi = away.norm()
            n = side * away / phi
        return n, phi

    def distance(self, points: np.ndarray) -> np.ndarray:
        out = np.abs(points) - self.half
        return np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(-1), 0.0)


class Cylinder(ExactShape):
    """Points within r [m] of the frame's z axis and within h [m] of its xy plane."""

    def __init__(self, r: float, h: float) -> None:
        self.r, = check_sizes("Sdf.cylinder", "r", r)
        self.h, = check_sizes("Sdf.cylinder", "h", h)
        self.radius, self.thinnest = float(np.hypot(self.r, self.h)), 2.0 * min(self.r, self.h)

    @ti.func
    def at(self, y):
        around = ti.sqrt(y[0] * y[0] + y[1] * y[1] + 1e-24)
        side, end = around - self.r, ti.abs(y[2]) - self.h
        radial = y / around
        radial[2] = 0.0 * y[2]
        axial = 0.0 * y
        axial[2] = ti.select(y[2] < 0, -1.0, 1.0)
        phi = ti.max(side, end)
        n = ti.select(side > end, radial, axial)
        if side > 0 and end > 0:  # off the edge
            phi = ti.sqrt(side * side + end * end)
            n = (side * radial + end * axial) / phi
        return n, phi

    def distance(self, points: np.ndarray) -> np.ndarray:
        out = np.stack([np.hypot(points[..., 0], points[..., 1]) - self.r, np.abs(points[..., 2]) - self.h], -1)
        return np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(-1), 0.0)


class Ellipsoid(Shape):
    """An ellipsoid of half axes [m] (3,). Distances are of first order: exact at the surface, where contact is."""

    def __init__(self, half: tuple[float, float, float]) -> None:
        self.half = check_sizes("Sdf.ellipsoid", "half", half, 3)
        self.radius, self.thinnest = max(self.half), 2.0 * min(self.half)

    @ti.func
    def at(self, y):
        scaled = ti.Vector([y[d] / self.half[d] for d in ti.static(range(3))])
        slope = ti.Vector([scaled[d] / self.half[d] for d in ti.static(range(3))])
        size, steepness = scaled.norm(1e-12), slope.norm(1e-12)
        return slope / steepness, size * (size - 1.0) / steepness

    def distance(self, points: np.ndarray) -> np.ndarray:
        scaled = points / self.half
        size = np.linalg.norm(scaled, axis=-1)
        return size * (size - 1.0) / np.maximum(np.linalg.norm(scaled / self.half, axis=-1), 1e-12)

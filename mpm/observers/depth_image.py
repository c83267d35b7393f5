"""Depth along a camera's axis, of rigid triangles and of particles, by a z-buffer."""

from typing import NamedTuple

import numpy as np

from mpm.backend import default_precision, is_shared, session_precision, ti
from mpm.backend.launching import Launcher

FAR = np.float32(np.inf)  # depth [m] of a pixel that sees nothing


class Lens(NamedTuple):
    """Intrinsics of a pinhole camera; pixel (row 0, column 0) is at the upper left, its centre at (0.5, 0.5)."""

    width: int
    """Columns of a picture."""
    height: int
    """Rows of a picture."""
    fx: float
    """Focal length along a row [pixels]."""
    fy: float
    """Focal length along a column [pixels]."""
    cx: float
    """Column of the optical axis [pixels]."""
    cy: float
    """Row of the optical axis [pixels]."""
    near: float = 0.01
    """Smallest depth [m] that is seen."""

    @staticmethod
    def from_fovy(width: int, height: int, fovy_deg: float, near: float = 0.01) -> "Lens":
        """Make a lens with square pixels and the axis in the middle, by its vertical field of view [deg]."""
        focal = 0.5 * height / np.tan(np.radians(0.5 * fovy_deg))
        return Lens(width, height, focal, focal, 0.5 * width, 0.5 * height, near)


class Parts:
    """Triangles of rigid parts.
    triangles (n, 3, 3): corners [m] in the part's axes. part (n,): number of each one's part, of `count`."""

    def __init__(self, triangles: np.ndarray, part: np.ndarray, count: int) -> None:
        a, b, c = np.moveaxis(np.asarray(triangles, float), 1, 0)
        normals = np.cross(b - a, c - a)
        self.triangles = np.ascontiguousarray(triangles, np.float32)
        self.part = np.ascontiguousarray(part, np.int32)
        self.planes = np.concatenate([normals, -np.sum(normals * a, axis=1)[:, None]], axis=1).astype(np.float32)
        """Of each triangle (n, 4): positive for a point on the side from which it is seen."""
        self.centres, self.radii = np.zeros((count, 3)), np.full(count, -1.0)
        for k in np.unique(part):
            corners = np.asarray(triangles, float)[part == k].reshape(-1, 3)
            self.centres[k] = 0.5 * (corners.min(0) + corners.max(0))
            self.radii[k] = np.linalg.norm(corners - self.centres[k], axis=1).max()


@ti.data_oriented
class DepthImage:
    """Draws triangles into a picture of depths; camera axes: x right, y down, z forward.
    A triangle is seen from the side on which its corners are counter-clockwise."""

    def __init__(self, lens: Lens) -> None:
        session_precision()  # starts the backend
        self.lens, self.on_gpu = lens, is_shared()
        self.size = (float(lens.width), float(lens.height))
        self._numbers = np.array([lens.fx, lens.fy, lens.cx, lens.cy, lens.near, 0.0], np.float32)
        self._parts_launch = Launcher(self, DepthImage._draw_parts)
        self._grains_launch = Launcher(self, DepthImage._draw_grains)

    def empty(self) -> np.ndarray:
        """Return a picture (height, width), float32, that sees nothing: FAR everywhere."""
        return np.full((self.lens.height, self.lens.width), FAR, np.float32)

    def draw_parts(self, parts: Parts, frames: np.ndarray, depth: np.ndarray) -> None:
        """Draw rigid parts into a picture (height, width), float32.
        frames (m, 12): of each part, the rotation (row by row) and the position [m] that take its axes to the
        camera's."""
        R, t = frames[:, :9].reshape(-1, 3, 3), frames[:, 9:]
        eyes = -np.einsum("mij,mi->mj", R, t)
        shown = self._are_in_view(np.einsum("mij,mj->mi", R, parts.centres) + t, parts.radii)
        rows = np.concatenate([frames, eyes, shown[:, None]], axis=1).astype(np.float32)
        with default_precision("f32"):
            self._parts_launch(parts.triangles, parts.planes, parts.part, rows, self._numbers, depth)

    def _are_in_view(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Return which balls (m,) the picture can show; centres (m, 3) in camera axes."""
        lens, seen = self.lens, (radii >= 0.0) & (centres[:, 2] + radii > self.lens.near)
        for axis, focal, middle, size in ((0, lens.fx, lens.cx, lens.width), (1, lens.fy, lens.cy, lens.height)):
            for edge, sign in ((-middle / focal, 1.0), ((size - middle) / focal, -1.0)):
                distance = sign * (centres[:, axis] - edge * centres[:, 2]) / np.hypot(1.0, edge)
                seen &= distance > -radii
        return seen

    def draw_grains(self, positions: np.ndarray, facets: np.ndarray, frame: np.ndarray, radius: float,
                    depth: np.ndarray) -> None:
        """Draw a small solid at each position into a picture (height, width), float32.
        positions (n, 3 or more), float32: in the world [m]. facets (n or more, k, 3, 3), float32: corners [m] of the
        triangles of each solid about its position, in world axes. frame (12,): as of a part, from the world. radius: of
        a ball [m] that holds each solid; those that are hidden as wholes are left out."""
        self._numbers[5] = radius
        with default_precision("f32"):
            self._grains_launch(positions, facets, np.ascontiguousarray(frame, np.float32), self._numbers, depth)

    @ti.kernel
    def _draw_parts(self, triangles: ti.types.ndarray(), planes: ti.types.ndarray(), part: ti.types.ndarray(),
                    frames: ti.types.ndarray(), numbers: ti.types.ndarray(), depth: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for i in range(triangles.shape[0]):
            p = part[i]
            side = planes[i, 3]
            for d in ti.static(range(3)):
                side += planes[i, d] * frames[p, 12 + d]
            if frames[p, 15] > 0.0 and side > 0.0:
                R = ti.Matrix([[frames[p, 3 * r + c] for c in range(3)] for r in range(3)])
                t = ti.Vector([frames[p, 9 + r] for r in range(3)])
                a, b, c = [R @ ti.Vector([triangles[i, k, d] for d in range(3)]) + t for k in ti.static(range(3))]
                self._draw(a, b, c, numbers, depth)

    @ti.kernel
    def _draw_grains(self, positions: ti.types.ndarray(), facets: ti.types.ndarray(), frame: ti.types.ndarray(),
                     numbers: ti.types.ndarray(), depth: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for i in range(positions.shape[0]):
            R = ti.Matrix([[frame[3 * r + c] for c in range(3)] for r in range(3)])
            x = R @ ti.Vector([positions[i, d] for d in range(3)]) + ti.Vector([frame[9 + r] for r in range(3)])
            if self._can_be_seen(x, numbers, depth):
                for f in range(facets.shape[1]):
                    a, b, c = [R @ ti.Vector([facets[i, f, k, d] for d in range(3)]) + x for k in ti.static(range(3))]
                    self._draw(a, b, c, numbers, depth)

    @ti.func
    def _can_be_seen(self, x, numbers: ti.template(), depth: ti.template()):
        """Whether a solid within `radius` of x could be nearer than what its pixels show already."""
        radius, near = numbers[5], numbers[4]
        front, seen = x.z - radius, x.z + radius > near
        if front > near:
            seen, low, high = False, ti.Vector([0, 0]), ti.Vector([0, 0])
            for d in ti.static(range(2)):
                reach, middle = numbers[d] * radius / front, numbers[d] * x[d] / x.z + numbers[2 + d] - 0.5
                # seen from the side, a ball's outline is not about its centre's pixel: one pixel and a third more
                low[d] = ti.cast(ti.floor(ti.max(middle - 1.33 * reach - 1.0, 0.0)), ti.i32)
                high[d] = ti.cast(ti.ceil(ti.min(middle + 1.33 * reach + 1.0, self.size[d] - 1.0)), ti.i32)
            for row in range(low.y, high.y + 1):
                for column in range(low.x, high.x + 1):
                    if depth[row, column] > front:
                        seen = True
        return seen

    @ti.func
    def _draw(self, a, b, c, numbers: ti.template(), depth: ti.template()):
        """Draw one triangle with corners in camera axes: each pixel's ray is met with its plane, so none is clipped."""
        volume = -a.dot(b.cross(c))  # positive where the camera is on the side that is seen
        nearest, farthest = ti.min(a.z, b.z, c.z), ti.max(a.z, b.z, c.z)
        if volume > 0.0 and farthest > numbers[4]:
            low, high = ti.Vector([0, 0]), ti.Vector([0, 0])
            if nearest > numbers[4]:
                for d in ti.static(range(2)):
                    u, v, w = [numbers[d] * p[d] / p.z + numbers[2 + d] - 0.5 for p in ti.static((a, b, c))]
                    low[d], high[d] = self._pixels(ti.min(u, v, w), ti.max(u, v, w), d)
            else:  # the part in front of the plane at the least depth
                for d in ti.static(range(2)):
                    least, most = 1e6, -1e6
                    for p, q in ti.static(((a, b), (b, c), (c, a))):
                        if p.z > numbers[4]:
                            u = p[d] / p.z
                            least, most = ti.min(least, u), ti.max(most, u)
                        if (p.z > numbers[4]) != (q.z > numbers[4]):
                            s = (numbers[4] - p.z) / (q.z - p.z)
                            v = (p[d] + s * (q[d] - p[d])) / numbers[4]
                            least, most = ti.min(least, v), ti.max(most, v)
                    low[d], high[d] = self._pixels(numbers[d] * least + numbers[2 + d] - 0.5,
                                                   numbers[d] * most + numbers[2 + d] - 0.5, d)
            if low.x <= high.x and low.y <= high.y:
                n_a, n_b, n_c = c.cross(b), a.cross(c), b.cross(a)
                for row in range(low.y, high.y + 1):
                    for column in range(low.x, high.x + 1):
                        ray = ti.Vector([(ti.cast(column, ti.f32) + 0.5 - numbers[2]) / numbers[0],
                                         (ti.cast(row, ti.f32) + 0.5 - numbers[3]) / numbers[1], 1.0])
                        share_a, share_b, share_c = ray.dot(n_a), ray.dot(n_b), ray.dot(n_c)
                        if share_a >= 0.0 and share_b >= 0.0 and share_c >= 0.0:
                            total = share_a + share_b + share_c
                            if total > 0.0 and volume > numbers[4] * total:
                                if ti.static(self.on_gpu):
                                    ti.atomic_min(depth[row, column], volume / total)
                                else:
                                    depth[row, column] = ti.min(depth[row, column], volume / total)

    @ti.func
    def _pixels(self, low, high, d: ti.template()):
        """Return the first and last pixel whose centre is between two places [pixels] along an edge of the picture."""
        last = self.size[d] - 1.0
        return (ti.cast(ti.ceil(ti.min(ti.max(low, 0.0), last + 1.0)), ti.i32),
                ti.cast(ti.floor(ti.max(ti.min(high, last), -1.0)), ti.i32))

"""Signed distance of a union of solids that are placed in one frame."""

from collections.abc import Hashable

import numpy as np

from mpm.backend import ti
from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import Pose, check_pose
from mpm.geometry.shape import Shape, sign


class Union(Shape):
    """Several solids, each with its pose in a common frame: the distance is that of the closest."""

    def __init__(self, parts: list[tuple[Shape, Pose]]) -> None:
        if not parts:
            raise InvalidValue("Sdf.union: no parts; accepted: one (solid, pose) or more")
        for k, (_, pose) in enumerate(parts):
            check_pose(f"Sdf.union: part {k}", pose)
        self.solids = [solid for solid, _ in parts]
        self._inverse = [pose.inverse() for _, pose in parts]
        self.places = tuple(tuple(float(c) for c in pose.position) for pose in self._inverse)
        self.axes = tuple(tuple(float(c) for c in pose.matrix.ravel()) for pose in self._inverse)
        self.radius = max(float(np.linalg.norm(pose.position)) + solid.radius for solid, pose in parts)
        self.passage = min(solid.passage for solid in self.solids)

    def lay_out(self) -> None:
        """Allocate the fields of all solids, once."""
        for solid in self.solids:
            solid.lay_out()

    def signature(self) -> Hashable:
        return sign(self, *[solid.signature() for solid in self.solids])

    @ti.func
    def at(self, y):
        n = 0.0 * y
        phi = 0.0 * y[0] + 1e6
        for k in ti.static(range(len(self.solids))):
            a, c = ti.static(self.axes[k]), ti.static(self.places[k])
            R = ti.Matrix([[a[0], a[1], a[2]], [a[3], a[4], a[5]], [a[6], a[7], a[8]]])
            n_k, phi_k = self.solids[k].at(R @ y + ti.Vector([c[0], c[1], c[2]]))
            if phi_k < phi:
                phi = phi_k
                n = R.transpose() @ n_k
        return n, phi

    @ti.func
    def least_distance(self, y):
        """Return a lower bound [m] of the distance from y to the nearest of the solids."""
        least = 0.0 * y[0] + 1e6
        for k in ti.static(range(len(self.solids))):
            a, c = ti.static(self.axes[k]), ti.static(self.places[k])
            R = ti.Matrix([[a[0], a[1], a[2]], [a[3], a[4], a[5]], [a[6], a[7], a[8]]])
            least = ti.min(least, self.solids[k].least_distance(R @ y + ti.Vector([c[0], c[1], c[2]])))
        return least

    def distance(self, points: np.ndarray) -> np.ndarray:
        each = [solid.distance(inverse.apply(points)) for solid, inverse in zip(self.solids, self._inverse)]
        return np.min(each, axis=0)

    def least_thickness(self) -> float:
        return min(solid.least_thickness() for solid in self.solids)

"""Signed distances between the tool and points on the containers' surfaces."""

from functools import cache

import numpy as np
import trimesh

from mpm import Pose
from mpm.geometry.sampled_sdf import Lattice
from robosim.config.rehearsal import RehearsalConfig
from robosim.scene.field import TOOL_SPACING
from robosim.scene.models import container_shape
from robosim.shapes import ToolShape, tool_shape

POINTS_PER_CONTAINER = 20_000
"""Sampled points on the surface of each container: about 2 mm apart."""
BOX_MARGIN = 1e-5
"""[m] by which the tool's bounding box is enlarged for the first selection of points: above single-precision error."""
LOOKOUT = 5e-3
"""Clearance [m] up to which it is measured, so that it need not be in every step."""
DIFFERENCE_STEP = 1e-3
"""[m] of the central differences of the tool's signed distance: the spacing of its lattice."""


def monitor_containers(config: RehearsalConfig) -> "ContainerSurface | None":
    """Return the surfaces of a rehearsal's containers; None without one, or where they are not monitored so."""
    return ContainerSurface(config) if config.containers and "sdf" in config.tool_container else None


@cache
def build_real_tool_sdf(shape: ToolShape) -> Lattice:
    """Build the signed distance of a tool with its real wall, in its own frame."""
    return shape.real_distance(TOOL_SPACING)


class ContainerSurface:
    """Points on the surfaces of a rehearsal's containers, tested against the distance of a tool at world poses."""

    def __init__(self, config: RehearsalConfig) -> None:
        self._sdf = build_real_tool_sdf(tool_shape(config.tool))
        points = []
        for name, container in config.containers.items():
            walls = container_shape(name, container).walls()
            local = trimesh.sample.sample_surface(walls, POINTS_PER_CONTAINER, seed=0)[0]
            points.append(container.pose.apply(local))
        self._points = np.concatenate(points)
        self._points_f32 = np.ascontiguousarray(self._points.T, np.float32)
        """The same (3, n), for the selection of the few that lie in the tool's bounding box."""
        low, high = self._sdf.bounds
        self._low, self._high = low - BOX_MARGIN, high + BOX_MARGIN
        self._rim = self._points[:, 2].max()
        self._last_pose, self._clearance = Pose.identity(), 0.0
        """Where the tool was when its clearance [m] was last measured."""
        self.penetrations = 0
        """Points inside the tool, summed over all calls of `record_penetrations`."""
        self.depth = 0.0
        """Largest penetration depth [m] over these calls."""

    def measure(self, pose: Pose, reach: float) -> float:
        """Return the distance [m] of the closest point from the tool at a pose, negative inside it; at most `reach`."""
        points = self._select_near(pose, reach)
        return min(float(self._sdf.distance(points).min()), reach) if len(points) else reach

    def record_penetrations(self, pose: Pose) -> None:
        """Add the points inside the tool at a pose to `penetrations` and `depth`.
        While the tool has moved less than the clearance that was found last, none can be."""
        turn = 4.0 * np.arcsin(min(0.5 * float(np.linalg.norm(pose.quaternion - self._last_pose.quaternion)), 1.0))
        moved = float(np.linalg.norm(pose.position - self._last_pose.position)) + self._sdf.radius * turn
        if moved < self._clearance:
            return
        points = self._select_near(pose, LOOKOUT)
        distance = self._sdf.distance(points) if len(points) else np.array([LOOKOUT])
        self._last_pose, self._clearance = pose, min(float(distance.min()), LOOKOUT)
        if self._clearance < 0.0:
            self.penetrations += int(np.sum(distance < 0))
            self.depth = max(self.depth, -self._clearance)

    def compute_displacement(self, pose: Pose, margin: float) -> np.ndarray:
        """Compute the displacement (3,) [m] of the tool that restores a clearance `margin` [m]; zero where it is kept.
        It leads away from the closest point, along the gradient of the signed distance."""
        points = self._select_near(pose, margin)
        distance = self._sdf.distance(points) if len(points) else np.array([margin])
        closest = int(distance.argmin())
        if distance[closest] >= margin:
            return np.zeros(3)
        stencil = points[closest] + DIFFERENCE_STEP * np.concatenate([np.eye(3), -np.eye(3)])
        gradient = np.subtract(*self._sdf.distance(stencil).reshape(2, 3))
        length = np.linalg.norm(gradient)
        if length == 0.0:  # on the medial surface of the tool no direction is better than its opposite
            return np.zeros(3)
        return -(margin - distance[closest]) * (pose.matrix @ gradient) / length

    def _select_near(self, pose: Pose, margin: float) -> np.ndarray:
        """Select the points (n, 3) [m], in the tool's frame, in the box of its lattice, or `margin` [m] around it."""
        R = pose.matrix.T
        along_z = R[:, 2]
        lowest = pose.position[2] + float(np.minimum(along_z * self._low, along_z * self._high).sum())
        if lowest - margin >= self._rim:
            return np.empty((0, 3))
        origin, inside = R @ pose.position, np.ones(len(self._points), bool)
        for x, low, high in zip(R.astype(np.float32) @ self._points_f32, self._low + origin, self._high + origin):
            inside &= (x > np.float32(low - margin)) & (x < np.float32(high + margin))
        return pose.inverse().apply(self._points[inside])

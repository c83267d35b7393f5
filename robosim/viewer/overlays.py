"""What is drawn over a scene: paths, the force of the grains, regions that count, and waypoints."""

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

import mpm
from robosim.recordings.frames import SceneState
from robosim.recordings.header import RegionEntry, region_pose
from robosim.recordings.reader import Recording
from robosim.viewer.charts import History

COMMANDED, REACHED, FORCE, PLACE, INSIDE = (40, 110, 220), (230, 120, 20), (200, 30, 60), (30, 140, 80), (120, 60, 170)
"""RGB of the lines."""
LABEL_ROOM = 0.05
"""Distance [m] of two waypoints that a label each needs."""
LONGEST, LEAST_SCALE = 0.2, 0.05
"""Length [m] of the arrow of the largest force of the grains, and the force [N] that counts as the largest at least."""
OVERLAYS: tuple[str, ...] = ("path", "force", "regions", "inside of the tool", "waypoints")
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
EDGES = [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)]


class Overlays:
    """The overlays of a recording, each of which can be hidden."""

    def __init__(self, server: viser.ViserServer, recording: Recording, history: History) -> None:
        self._server, self._recording, self._history = server, recording, history
        self.visible = dict.fromkeys(OVERLAYS, False)
        self._nodes: dict[str, list[Any]] = {name: [] for name in OVERLAYS}
        self._regions: list[tuple[RegionEntry, Any]] = []
        self._drawn: dict[str, Any] = {}
        header, scene = recording.header, server.scene
        thin: dict[str, Any] = {"thickness": 2.0, "thickness_units": "screen", "visible": False}
        for name, points in recording.paths.items():
            if len(points) > 1:
                self._nodes["path"].append(scene.add_line_segments(f"/overlays/path/{name}", join(points), COMMANDED,
                                                                   **thin))
        for region in header.regions:
            lines = scene.add_line_segments(f"/overlays/regions/{region.name}", outline(region),
                                            INSIDE if region.body else PLACE, **thin)
            self._nodes["inside of the tool" if region.body else "regions"].append(lines)
            self._regions.append((region, lines))
        for point in header.waypoints:
            node, place = f"/overlays/waypoints/{point.name}", np.array(point.position)
            self._nodes["waypoints"].append(scene.add_icosphere(node, 0.004, COMMANDED, position=place, visible=False))
        for name, place in join_labels([(point.name, np.array(point.position)) for point in header.waypoints]):
            self._nodes["waypoints"].append(scene.add_label(f"/overlays/labels/{name}", name, position=place,
                                                            visible=False))

    def set_visible(self, kind: str, visible: bool) -> None:
        """Show or hide an overlay."""
        self.visible[kind] = visible
        for node in self._nodes[kind]:
            node.visible = visible

    def show(self, k: int, scene: SceneState, poses: dict[str, mpm.Pose]) -> None:
        """Follow the k-th frame."""
        for region, lines in self._regions:
            pose = region_pose(region, poses)
            lines.position, lines.wxyz = pose.position, pose.quaternion
        tool, draw = self._recording.header.tool, self._server.scene
        if tool in poses and self.visible["force"]:  # of the grains, at the tool's origin
            origin = poses[tool].position
            arrow = LONGEST * scene.wrench[:3] / max(self._history.largest_force, LEAST_SCALE)
            points = np.array([[origin, origin + arrow + [0.0, 0.0, 1e-6]]], np.float32)
            self._draw("force", points, lambda: draw.add_arrows(
                "/overlays/force", points, FORCE, shaft_radius=0.003, head_radius=0.007, head_length=0.018))
        if tool in poses and self.visible["path"] and k > 0:
            reached = join(self._history.tool_positions[: k + 1])
            self._draw("path", reached, lambda: draw.add_line_segments(
                "/overlays/path/reached", reached, REACHED, thickness=3.0, thickness_units="screen"))

    def _draw(self, kind: str, points: np.ndarray, make: Callable[[], Any]) -> None:
        """Give what an overlay draws anew in each frame its points; make: makes it with them."""
        if kind in self._drawn:
            self._drawn[kind].points = points
        else:
            self._drawn[kind] = make()
            self._nodes[kind].append(self._drawn[kind])


def join_labels(points: list[tuple[str, np.ndarray]]) -> list[tuple[str, np.ndarray]]:
    """Return labels and their places (3,) [m]: names of points so close that they would cover each other share one."""
    labels: list[tuple[list[str], np.ndarray]] = []
    for name, place in points:
        near = next((names for names, there in labels if np.linalg.norm(there - place) < LABEL_ROOM), None)
        if near is None:
            labels.append(([name], place))
        else:
            near.append(name)
    return [(", ".join(names), place) for names, place in labels]


def join(points: np.ndarray) -> np.ndarray:
    """Return the segments (n - 1, 2, 3) of a line through points (n, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def outline(region: RegionEntry) -> np.ndarray:
    """Return the edges (n, 2, 3) [m] of a region in its own frame."""
    half = np.minimum(region.half, 2.0)
    if not region.round:
        return np.array([[CORNERS[a] * half, CORNERS[b] * half] for a, b in EDGES], np.float32)
    angles = np.linspace(0.0, 2.0 * np.pi, 25)
    rings = [np.stack([np.cos(angles), np.sin(angles), np.full_like(angles, z)], 1) * half for z in (-1.0, 1.0)]
    return np.concatenate([*map(join, rings), np.stack(rings, 1)[::6].astype(np.float32)])

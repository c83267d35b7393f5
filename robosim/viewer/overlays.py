"""What is drawn over a scene: paths, the force of the grains, regions that count, and waypoints."""

from typing import Any

import numpy as np
import viser

import mpm
from robosim.recordings.frames import SceneState
from robosim.recordings.header import RegionEntry, region_pose
from robosim.recordings.reader import Recording
from robosim.viewer.history import History

COMMANDED, REACHED, FORCE, PLACE, INSIDE = (40, 110, 220), (230, 120, 20), (200, 30, 60), (30, 140, 80), (120, 60, 170)
"""RGB of the lines."""
LONGEST, LEAST_SCALE = 0.2, 0.05
"""Length [m] of the arrow of the largest force of the grains, and the force [N] that counts as the largest at least."""
OVERLAYS: tuple[str, ...] = ("path", "force", "regions", "inside of the tool", "waypoints")
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
EDGES = [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)]
ROUND_POINTS = 24


class Overlays:
    """The overlays of a recording, each of which can be hidden."""

    def __init__(self, server: viser.ViserServer, recording: Recording, history: History) -> None:
        self._server, self._recording, self._history = server, recording, history
        self.visible = dict.fromkeys(OVERLAYS, False)
        self._nodes: dict[str, list[Any]] = {name: [] for name in OVERLAYS}
        self._regions: list[tuple[RegionEntry, Any]] = []
        self._reached, self._arrow = None, None
        header, scene = recording.header, server.scene
        for name, points in recording.paths.items():
            if len(points) > 1:
                self._add("path", scene.add_line_segments(f"/overlays/path/{name}", join(points), COMMANDED,
                                                          thickness=2.0, thickness_units="screen", visible=False))
        for region in header.regions:
            kind = "inside of the tool" if region.body else "regions"
            lines = scene.add_line_segments(f"/overlays/regions/{region.name}", outline(region),
                                            INSIDE if region.body else PLACE, thickness=2.0,
                                            thickness_units="screen", visible=False)
            self._add(kind, lines)
            self._regions.append((region, lines))
        for point in header.waypoints:
            place = np.array(point.position)
            self._add("waypoints", scene.add_icosphere(f"/overlays/waypoints/{point.name}", 0.004, COMMANDED,
                                                       position=place, visible=False))
            self._add("waypoints", scene.add_label(f"/overlays/waypoints/{point.name}/name", point.name,
                                                   visible=False))

    def _add(self, kind: str, node: Any) -> None:
        self._nodes[kind].append(node)

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
        tool = self._recording.header.tool
        if tool in poses and self.visible["force"]:
            self._show_force(scene.wrench[:3], poses[tool])
        if tool in poses and self.visible["path"]:
            self._show_reached(k)

    def _show_force(self, force: np.ndarray, pose: mpm.Pose) -> None:
        """Draw the force of the grains (3,) [N] at the tool's origin."""
        arrow = LONGEST * force / max(self._history.largest_force, LEAST_SCALE)
        points = np.array([[pose.position, pose.position + arrow + [0.0, 0.0, 1e-6]]], np.float32)
        if self._arrow is None:
            self._arrow = self._server.scene.add_arrows("/overlays/force", points, FORCE, shaft_radius=0.003,
                                                        head_radius=0.007, head_length=0.018)
            self._add("force", self._arrow)
        else:
            self._arrow.points = points

    def _show_reached(self, k: int) -> None:
        """Draw the path of the tool up to the k-th frame."""
        if k == 0:
            return
        points = join(self._history.tool_positions[: k + 1])
        if self._reached is None:
            self._reached = self._server.scene.add_line_segments("/overlays/path/reached", points, REACHED,
                                                                 thickness=3.0, thickness_units="screen")
            self._add("path", self._reached)
        else:
            self._reached.points = points


def join(points: np.ndarray) -> np.ndarray:
    """Return the segments (n - 1, 2, 3) of a line through points (n, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def outline(region: RegionEntry) -> np.ndarray:
    """Return the edges (n, 2, 3) [m] of a region in its own frame."""
    half = np.minimum(region.half, 2.0)
    if not region.round:
        return np.array([[CORNERS[a] * half, CORNERS[b] * half] for a, b in EDGES], np.float32)
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND_POINTS + 1)
    rings = [np.stack([np.cos(angles), np.sin(angles), np.full_like(angles, z)], 1) * half for z in (-1.0, 1.0)]
    return np.concatenate([*map(join, rings), np.stack(rings, 1)[::6].astype(np.float32)])

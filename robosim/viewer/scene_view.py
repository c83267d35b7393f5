"""The scene of a recording in a browser: bodies, grains and overlays, at any of its frames."""

from typing import Any

import numpy as np
import viser

import mpm
from robosim.recordings.frames import GrainState, SceneState
from robosim.recordings.header import CameraEntry, find_placed
from robosim.recordings.reader import Recording
from robosim.rendering.grain_skin import find_hidden
from robosim.viewer.charts import History
from robosim.viewer.grain_colours import GrainColours
from robosim.viewer.overlays import Overlays
from robosim.viewer.sight import find_in_sight, read_sight

CELL_IN_RADII = 4.0
"""Side of the cubes that find grains inside a heap, which nobody sees, in radii of a drawn grain."""
GRAIN_SIZE = 1.8
"""Diameter of a drawn point, in radii of a grain."""
BACKGROUND = np.full((1, 1, 3), 214, np.uint8)
SKY, GROUND = (235, 240, 250), (150, 145, 140)
"""RGB of the light from above and from below."""


class SceneView:
    """Draws frames of a recording with a server's scene."""

    def __init__(self, server: viser.ViserServer, recording: Recording, history: History) -> None:
        self.server, self.recording, header = server, recording, recording.header
        self.colouring, self.frame = "material", -1
        server.scene.set_up_direction("+z")
        server.scene.set_background_image(BACKGROUND)
        server.scene.world_axes.visible = False
        server.scene.configure_default_lights(enabled=False)
        server.scene.configure_environment_map(None)  # pictures of surroundings would come from a network
        server.scene.add_light_hemisphere("/lights/sky", sky_color=SKY, ground_color=GROUND, intensity=1.3)
        server.scene.add_light_directional("/lights/key", intensity=1.6, position=(1.2, -0.9, 2.5))
        server.scene.add_light_directional("/lights/fill", intensity=0.5, position=(0.5, 2.0, 1.5))
        self._bodies: dict[str, Any] = {}
        for body in header.bodies:
            self._bodies[body.name] = server.scene.add_glb(
                f"/bodies/{body.name}", recording.shapes[body.name], position=np.array(body.position),
                wxyz=np.array(body.quaternion), cast_shadow=False, receive_shadow=False) \
                if body.name in recording.shapes else server.scene.add_frame(f"/bodies/{body.name}", show_axes=False)
        self._centre = (np.array(header.lower) + header.upper) / 2.0
        self._colours = GrainColours(header.grains, header.colour)
        self._grains, self._sight = None, None
        if header.grains:
            self._grains = server.scene.add_point_cloud(
                "/grains", np.zeros((header.grains, 3)), np.zeros((header.grains, 3), np.uint8), position=self._centre,
                point_size=GRAIN_SIZE * header.grain_radius, point_shape="circle", point_shading="gradient",
                precision="float16")
        self.overlays = Overlays(server, recording, history)

    def show(self, k: int) -> None:
        """Show the k-th frame."""
        scene, grains = self.recording.scene(k), self.recording.grains(k)
        poses = self.body_poses(scene)
        with self.server.atomic():
            for name, pose in poses.items():
                self._bodies[name].position, self._bodies[name].wxyz = pose.position, pose.quaternion
            self._show_grains(grains, poses)
            self.overlays.show(k, scene, poses)
        self.frame = k

    def follow_camera(self) -> None:
        """Choose the grains that are drawn anew, where the camera of the page has moved."""
        sight = read_sight(self.server)
        distance = 0.0 if sight is None else float(np.linalg.norm(sight.eye - self._centre))
        if (self.frame >= 0 and (sight is None) != (self._sight is None)) or \
                (sight is not None and sight.has_moved(self._sight, distance)):
            self.recolour(self.colouring)

    def recolour(self, colouring: str) -> None:
        """Colour the grains otherwise; raises KeyError for no colouring."""
        self.colouring = colouring
        if self.frame >= 0:
            self._show_grains(self.recording.grains(self.frame), self.body_poses(self.recording.scene(self.frame)))

    def body_poses(self, scene: SceneState) -> dict[str, mpm.Pose]:
        """Return the world poses of the moving bodies."""
        return {body.name: mpm.Pose(row[:3], row[3:]) for body, row in zip(self.recording.header.moving, scene.poses)}

    def _show_grains(self, grains: GrainState, poses: dict[str, mpm.Pose]) -> None:
        if self._grains is None:
            return
        regions = self.recording.header.regions
        placed = find_placed(regions, poses, grains.positions) if self.colouring == "outside" else None
        colours = self._colours.colours(grains, self.colouring, placed)
        radius = self.recording.header.grain_radius
        seen = ~find_hidden(grains.positions, CELL_IN_RADII * radius)
        self._sight = read_sight(self.server)
        if self._sight is not None:
            seen &= find_in_sight(grains.positions, self._sight, radius)
        self._grains.points = (grains.positions[seen] - self._centre).astype(np.float16)
        self._grains.colors = colours[seen]


def aim_first_camera(server: viser.ViserServer, cameras: list[CameraEntry], preferred: str) -> None:
    """Let a page begin at a camera, or at the first where there is none of the name."""
    first = next((camera for camera in cameras if camera.name == preferred), next(iter(cameras), None))
    if first is not None:
        initial = server.initial_camera
        initial.position, initial.look_at, initial.fov = first.position, first.target, float(np.radians(first.fov_deg))

"""The scene of a recording in a browser: bodies, the grains that its camera sees, coloured, and overlays."""

from typing import Any, Literal, NamedTuple, get_args

import matplotlib
import numpy as np
import viser
from scipy.spatial.transform import Rotation

import mpm
from robosim.recordings.frames import GrainState
from robosim.recordings.header import CameraEntry, body_poses, find_placed
from robosim.recordings.reader import Recording
from robosim.rendering.grain_skin import find_surface
from robosim.viewer.charts import History
from robosim.viewer.overlays import Overlays

Colouring = Literal["material", "speed", "pressure", "awake", "outside"]
COLOURINGS: tuple[Colouring, ...] = get_args(Colouring)
LEGENDS: dict[str, str] = {
    "material": "", "speed": "speed: dark {} m/s, bright {} m/s", "pressure": "pressure: dark {} Pa, bright {} Pa",
    "awake": "blue: asleep, not computed", "outside": "red: outside of tool and places",
}
"""Colouring -> what its colours mean; {}: values of the darkest and the brightest."""
SAMPLED, SHARE, DECADES = 12, 0.995, 3
"""Frames of a recording that give the range of a quantity, the share of grains below its brightest colour, and the
decades below that to its darkest."""
ASLEEP, OUTSIDE = (64, 97, 158), (214, 48, 32)
"""RGB of grains that sleep, and of those outside of all places."""
SHADES = 0.16
"""Half range of the brightness of grains of one material: without it a heap has no surface."""
CELL, DEPTH = 1.6, 2.5
"""Side of the cells in which grains hide each other, and the depth below the first one to which they are seen, in
radii of a grain: the first layer and what shines through it."""
MARGIN = 1.15
"""Part of the picture, from its middle, in which grains are kept, so that a small turn shows no gap."""
MOVED, TURNED = 0.02, 0.02
"""Movement of a camera, in its distance from what it looks at, and turn [rad], from which grains are chosen anew."""
CELL_IN_RADII = 4.0
"""Side of the cubes that find grains inside a heap, which nobody sees, in radii of a drawn grain."""
GRAIN_SIZE = 1.8
"""Diameter of a drawn point, in radii of a grain."""
BACKGROUND = np.full((1, 1, 3), 214, np.uint8)
SKY, GROUND = (235, 240, 250), (150, 145, 140)
"""RGB of the light from above and from below."""


class GrainColours:
    """Colours of n grains; material: RGB, 0 to 1."""

    def __init__(self, n: int, material: tuple[float, float, float]) -> None:
        shades = np.random.default_rng(0).uniform(1.0 - 2.0 * SHADES, 1.0, (n, 1))
        self._material = np.clip(255.0 * shades * np.asarray(material), 0.0, 255.0).astype(np.uint8)
        self._tables = {colouring: (255 * matplotlib.colormaps[name](np.linspace(0, 1, 256))[:, :3]).astype(np.uint8)
                        for colouring, name in (("speed", "viridis"), ("pressure", "inferno"))}

    def colours(self, grains: GrainState, colouring: str, placed: np.ndarray | None = None,
                limits: tuple[float, float] = (0.0, 1.0)) -> np.ndarray:
        """Return colours (n, 3), uint8; placed (n,): which grains are in the tool or a place. limits: values of the
        darkest and the brightest colour."""
        if colouring in self._tables:  # on a logarithmic scale
            low, high = limits
            share = np.log(np.clip(quantity(grains, colouring), low, high) / low) / np.log(high / low)
            return self._tables[colouring][(255 * share).astype(np.uint8)]
        marked = {"awake": (~grains.awake, ASLEEP), "outside": (None if placed is None else ~placed, OUTSIDE)}
        chosen, colour = marked.get(colouring, (None, ASLEEP))
        if chosen is None or not chosen.any():
            return self._material
        result = self._material.copy()
        result[chosen] = colour
        return result


def quantity(grains: GrainState, colouring: str) -> np.ndarray:
    """Return the values (n,) that grains are coloured by."""
    return grains.speeds if colouring == "speed" else grains.pressures


def find_limits(recording: Recording, colouring: str) -> tuple[float, float]:
    """Return the values of the darkest and the brightest colour of a recording: decades, by some of its frames."""
    frames = np.unique(np.linspace(0, len(recording) - 1, SAMPLED).astype(int))
    largest = max(float(np.quantile(quantity(recording.grains(int(k)), colouring), SHARE)) for k in frames)
    high = 10.0 ** np.ceil(np.log10(max(largest, 1e-6)))
    return high / 10.0**DECADES, high


class Sight(NamedTuple):
    """A camera, as of a page."""

    eye: np.ndarray
    """(3,) [m]"""
    axes: np.ndarray
    """Columns: its axes to the right, down and ahead (3, 3)."""
    half_height: float
    """Tangent of half the vertical angle of the picture."""
    half_width: float

    def has_moved(self, other: "Sight | None", distance: float) -> bool:
        """Return whether another camera sees other grains; distance: to these [m]."""
        if other is None:
            return True
        turn = np.arccos(np.clip((np.trace(self.axes.T @ other.axes) - 1.0) / 2.0, -1.0, 1.0))
        return bool(np.linalg.norm(self.eye - other.eye) > MOVED * distance or turn > TURNED
                    or abs(self.half_height / other.half_height - 1.0) > TURNED
                    or abs(self.half_width / other.half_width - 1.0) > TURNED)


def read_sight(server: viser.ViserServer) -> Sight | None:
    """Return the camera of the only page; None where there is none, or where several see different things."""
    clients = list(server.get_clients().values())
    if len(clients) != 1:
        return None
    camera = clients[0].camera
    try:
        axes = Rotation.from_quat(camera.wxyz, scalar_first=True).as_matrix()
        half = float(np.tan(camera.fov / 2.0))
        return Sight(np.array(camera.position, float), axes, half, half * float(camera.aspect))
    except (AttributeError, ValueError):  # the page has not said yet where its camera is
        return None


def find_in_sight(positions: np.ndarray, sight: Sight, radius: float) -> np.ndarray:
    """Return which grains (n,) a camera sees past the others; radius: of a grain [m]. positions: (n, 3) [m]."""
    x, y, depth = ((positions - sight.eye) @ sight.axes).T
    ahead = np.maximum(depth, 1e-3)
    right, down = x / ahead, y / ahead
    kept = (depth > 0.0) & (np.abs(right) < MARGIN * sight.half_width) & (np.abs(down) < MARGIN * sight.half_height)
    if not kept.any():
        return kept
    inside = np.flatnonzero(kept)
    step = CELL * radius / float(np.median(ahead[inside]))
    columns, rows = (np.floor(part[inside] / step).astype(np.int64) for part in (right, down))
    columns -= columns.min()
    rows -= rows.min()
    cells = rows * (int(columns.max()) + 1) + columns
    nearest = np.full(int(cells.max()) + 1, np.inf)
    np.minimum.at(nearest, cells, depth[inside])
    kept[inside] = depth[inside] <= nearest[cells] + DEPTH * radius
    return kept


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
        self._limits: dict[str, tuple[float, float]] = {}
        if header.grains:
            self._grains = server.scene.add_point_cloud(
                "/grains", np.zeros((header.grains, 3)), np.zeros((header.grains, 3), np.uint8), position=self._centre,
                point_size=GRAIN_SIZE * header.grain_radius, point_shape="circle", point_shading="gradient",
                precision="float16")
        self.overlays = Overlays(server, recording, history)

    def show(self, k: int) -> None:
        """Show the k-th frame."""
        scene, grains = self.recording.scene(k), self.recording.grains(k)
        poses = body_poses(self.recording.header, scene.poses)
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
            self._show_again()

    def recolour(self, colouring: str) -> None:
        """Colour the grains otherwise; raises KeyError for no colouring."""
        self.colouring = colouring
        if colouring in ("speed", "pressure") and len(self.recording):
            self._limits[colouring] = find_limits(self.recording, colouring)
        self._show_again()

    def _show_again(self) -> None:
        """Show the grains of the frame that is shown."""
        if self.frame >= 0:
            self._show_grains(self.recording.grains(self.frame),
                              body_poses(self.recording.header, self.recording.scene(self.frame).poses))

    @property
    def legend(self) -> str:
        """What the colours mean."""
        return LEGENDS[self.colouring].format(*(f"{value:g}" for value in self._limits.get(self.colouring, ())))

    def _show_grains(self, grains: GrainState, poses: dict[str, mpm.Pose]) -> None:
        if self._grains is None:
            return
        regions = self.recording.header.regions
        placed = find_placed(regions, poses, grains.positions) if self.colouring == "outside" else None
        limits = self._limits.get(self.colouring, (0.0, 1.0))
        colours = self._colours.colours(grains, self.colouring, placed, limits)
        radius = self.recording.header.grain_radius
        seen, _ = find_surface(grains.positions, CELL_IN_RADII * radius)
        self._sight = read_sight(self.server)
        if self._sight is not None:
            seen = seen[find_in_sight(grains.positions[seen], self._sight, radius)]
        self._grains.points = (grains.positions[seen] - self._centre).astype(np.float16)
        self._grains.colors = colours[seen]


def aim_first_camera(server: viser.ViserServer, cameras: list[CameraEntry], preferred: str) -> None:
    """Let a page begin at a camera, or at the first where there is none of the name."""
    first = next((camera for camera in cameras if camera.name == preferred), next(iter(cameras), None))
    if first is not None:
        initial = server.initial_camera
        initial.position, initial.look_at, initial.fov = first.position, first.target, float(np.radians(first.fov_deg))

"""Terms that see: depth, colour and points of a camera in the scene."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import mujoco
import numpy as np

import mpm
from robosim.config.materials import MaterialConfig
from robosim.rendering.depth_camera import DepthCamera, find_noise
from robosim.rendering.grain_skin import GRAIN_RADIUS, add_grain_skin
from robosim.rendering.renderer import SceneRenderer
from robosim.robot.mjspec import compile_spec
from robosim.scene.grains import grain_volume
from robosim.senses.task_scene import SeenBodies, build_seen_spec
from robosim.senses.term import SenseScene, Sight, Term, box, check_count, check_option
from robosim.tasks.task import TaskConfig

Camera = str | Mapping[str, Any]
"""Name of a camera, or {"position": [m] (3,), "look_at": [m] (3,), "fovy_deg": 45} for one of one's own."""
MOST_PIXELS = 2048
"""Along an edge of a picture."""
MOST_POINTS = 65536


class DepthTerm(Term):
    """Depth [m] along the optical axis, row by row; zero where there is nothing, or nothing within `farthest`.

    camera: a name, or {"position": [m] (3,), "look_at": [m] (3,), "fovy_deg": 45}. width, height: in pixels.
    noise_model: "structured_light", "stereo" or None for exact depth."""

    name, unit = "depth", "m"
    all_grains = True

    def __init__(self, scene: SenseScene, camera: Camera = "task", width: int = 84, height: int = 84,
                 noise_model: str | None = None, farthest: float = 4.0) -> None:
        width, height = (check_count(self.name, key, n, MOST_PIXELS)
                         for key, n in (("width", width), ("height", height)))
        self._noise = find_noise(noise_model)
        self._farthest = check_option(self.name, "farthest", farthest, 0.1, 100.0)
        spec, name = build_seen_spec(scene.task, scene.arm, camera, marks=False)
        radius = GRAIN_RADIUS * grain_volume(scene.task) ** (1 / 3)
        self.camera = DepthCamera(compile_spec(spec), name, width, height, scene.task.grains.count, radius)
        self._bodies = SeenBodies(self.camera.model, scene.task)
        self.space = box(np.zeros((height, width)), np.full((height, width), self._farthest))

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        return self._measure_depth(sight, rng)[0]

    def _measure_depth(self, sight: Sight, rng: np.random.Generator) -> tuple[np.ndarray, mpm.Pose]:
        """Return the depth, and the pose of the camera."""
        if self._bodies.place(sight.setting.place, sight.pose, sight.qpos):
            self.camera.forget()
        pose = self.camera.look(self._bodies.data)
        depth = self.camera.depth(self._bodies.data, pose, sight.grains)
        if self._noise is not None:
            depth = self._noise.apply(depth, self.camera.lens.fx, rng)
        return np.where(depth <= self._farthest, depth, 0.0), pose


class PointCloudTerm(DepthTerm):
    """Points [m] in the world that a depth camera sees within the field's region.

    points: their number; drawn evenly among the pixels that see something there, again where there are fewer, and at
    the region's lower corner where there is none. Other options as of `DepthTerm`."""

    name, unit = "point_cloud", "m"

    def __init__(self, scene: SenseScene, points: int = 512, **camera: Any) -> None:
        super().__init__(scene, **camera)
        self._count, grid = check_count("point_cloud", "points", points, MOST_POINTS), scene.solver.grid
        self._low = np.asarray(grid.lower, float)
        self._high = self._low + grid.cells * grid.cell
        self.space = box(np.tile(self._low, (points, 1)), np.tile(self._high, (points, 1)))

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the points (n, 3), in the order of the picture's rows."""
        depth, pose = self._measure_depth(sight, rng)
        seen = self.camera.points(depth, pose)[depth > 0.0]
        seen = seen[((seen >= self._low) & (seen <= self._high)).all(1)]
        if not len(seen):
            return np.tile(self._low, (self._count, 1))
        return seen[np.linspace(0, len(seen), self._count, endpoint=False).astype(int)]


class TaskPicture:
    """Draws a sub-task with its grains by the renderer of films, width x height pixels; needs OpenGL."""

    def __init__(self, spec: mujoco.MjSpec, task: TaskConfig, material: MaterialConfig, width: int = 640,
                 height: int = 480) -> None:
        count = task.grains.count
        add_grain_skin(spec, count, GRAIN_RADIUS * grain_volume(task) ** (1 / 3), material.colour)
        self._model = compile_spec(spec)
        self._bodies = SeenBodies(self._model, task)
        self._renderer = SceneRenderer(self._model, count, width, height)

    def draw(self, camera: str, grains: np.ndarray, place: mpm.Pose, tool: mpm.Pose,
             qpos: np.ndarray | None) -> np.ndarray:
        """Return a picture (height, width, 3), uint8; grains: positions [m] (n, 3). Others as of `SeenBodies.place`."""
        self._bodies.place(place, tool, qpos)
        return self._renderer.draw(self._bodies.data, grains, camera)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.close()


class RgbTerm(Term):
    """Colour picture of a camera (height, width, 3), by the renderer of films; needs OpenGL.

    Options as of `DepthTerm`."""

    name, unit = "rgb", "1/255"
    all_grains = True

    def __init__(self, scene: SenseScene, camera: Camera = "task", width: int = 84, height: int = 84) -> None:
        width, height = (check_count("rgb", key, n, MOST_PIXELS) for key, n in (("width", width), ("height", height)))
        spec, self._camera = build_seen_spec(scene.task, scene.arm, camera)
        self._picture = TaskPicture(spec, scene.task, scene.material, width, height)
        self.space = gymnasium.spaces.Box(0, 255, (height, width, 3), np.uint8)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        return self._picture.draw(self._camera, sight.grains[:, :3].astype(float), sight.setting.place, sight.pose,
                                  sight.qpos)

    def close(self) -> None:
        self._picture.close()

"""Pictures by Filament, MuJoCo 4's physically based renderer, which draws with Vulkan: on a card or on the processor.
It needs neither OpenGL nor a display. MuJoCo's module is loaded by name: earlier versions do not have it."""

import contextlib
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robosim.base.errors import RobosimError
from robosim.rendering.grain_skin import Crystals, make_crystals
from robosim.rendering.renderer import aim
from robosim.rendering.views import View, Window

KEY = {"intensity": 60_000.0, "color": (1.0, 0.97, 0.92), "bulb_radius": 0.05, "softness": 1.0, "shadow_map_size": 2048}
"""The key light, which is as far away as the sun and casts soft shadows; intensity in lux."""
KEY_DIRECTION, KEY_POSITION, FAR = (-0.35, 0.45, -0.82), (0.0, 0.0, 3.0), 1e3
"""FAR: a distance [m] of a light whose rays are parallel."""
GUARD = 12
"""Rim [pixels] about a part of a picture, which is drawn with it: there its ambient occlusion lacks what is outside."""
GRAIN_ROUGHNESS, GRAIN_SPECULAR = 0.9, 0.2
ROOM = 1.25
"""Capacity of the mesh of grains, in what the first picture that it is too small for needs."""
APT_COMMAND = "apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers"
DEVICE_LINE = re.compile(r"Selected physical device '([^']*)'")
"""What Filament writes of the device that it has chosen."""
SOFTWARE = ("llvmpipe", "lavapipe", "swiftshader")
"""Names of Vulkan devices that are programs."""


class FilamentUnavailable(RobosimError, RuntimeError):
    """Filament cannot draw on this machine; the message says what is missing."""


class Device(NamedTuple):
    """What draws."""

    is_software: bool
    """What Filament's context is asked for."""
    name: str
    """As its driver gives it."""

    @property
    def text(self) -> str:
        """Who draws and on what, as a page says it."""
        where = " on the processor" if self.name.lower().startswith(SOFTWARE) else ""
        return f"Filament, {self.name}{where}"


class Grains(NamedTuple):
    """How grains are drawn."""

    count: int
    """Largest number of them."""
    radius: float
    """[m]"""
    colour: tuple[float, float, float]
    """RGB."""


class FilamentRenderer:
    """Draws frames of one model, with grains or without. width, height: in pixels. Raises FilamentUnavailable."""

    def __init__(self, model: mujoco.MjModel, grains: Grains | None, width: int = 1280, height: int = 720) -> None:
        is_software = find_device().is_software
        self._model, self._picture = model, np.empty((height, width, 3), np.uint8)
        self._api = api = importlib.import_module("mujoco.mjrf")
        with _silence():
            self._context = api.Context(api.ContextConfig(software_rendering=is_software,
                                                          graphics_api=api.GraphicsApi.GRAPHICS_API_VULKAN))
            self._resources = api.ModelResources(self._context, model)
            self._scene = self._context.create_scene(api.SceneParams())
            self._scene.configure_from_model(model)
            self._parts = [kind(self._scene, self._resources) for kind in (api.ModelLights, api.ModelRenderables)]
        self._key = self._context.create_light(
            api.LightParams(type=api.LightType.LIGHT_DIRECTIONAL, cast_shadow=True, **KEY))
        self._key.set_pose(KEY_POSITION, KEY_DIRECTION)
        self._scene.add_light(self._key)
        self._target = self._context.create_render_target(
            api.RenderTargetConfig(color_format=api.PixelFormat.PIXEL_FORMAT_RGB8))
        self._target.resize(width, height)
        self._read = api.ReadRequest(target=self._target)
        self._read.set_buffer(self._picture)
        self._request = api.RenderRequest(
            scene=self._scene, target=self._target, draw_mode=api.DrawMode.DRAW_MODE_DEFAULT, post_processing=True,
            reflections=True, shadows=True, skybox=True, haze=True, headlight=False)
        self._eye = mujoco.MjvScene(model, 1)
        self._heap = GrainMesh(api, self._context, self._scene, grains) if grains else None

    def draw(self, data: mujoco.MjData, positions: NDArray[np.floating] | None, camera: mujoco.MjvCamera
             ) -> NDArray[np.uint8]:
        """Draw the picture (height, width, 3) of a camera; positions (n, 3) [m] are those of the grains."""
        return self.begin(data, positions, camera)()

    def begin(self, data: mujoco.MjData, positions: NDArray[np.floating] | None, camera: str | mujoco.MjvCamera,
              window: Window | None = None) -> Callable[[], NDArray[np.uint8]]:
        """Draw a picture as `draw` does, or a part of it, and return what gives it, as that of other renderers does."""
        eye, (height, width) = aim(self._model, data, camera), self._picture.shape[:2]
        mujoco.mjv_updateScene(self._model, data, mujoco.MjvOption(), None, eye, 0, self._eye)  # its camera alone
        view, window = View.of(self._eye), window or Window.whole((height, width))
        drawn = window.grow(GUARD, (height, width))
        frustum = view.frustum((height, width), drawn)
        self._request.viewport = self._api.Rect(left=drawn.left, bottom=height - drawn.bottom,
                                                width=drawn.shape[1], height=drawn.shape[0])
        self._request.camera = self._api.Camera(
            pos=view.position, forward=view.axes[2], up=view.axes[1], frustum_center=frustum.centre,
            frustum_bottom=frustum.bottom, frustum_top=frustum.top, frustum_near=view.near, frustum_far=view.far)
        for part in self._parts:
            part.update(data)
        if self._heap is not None:
            self._heap.place(np.empty((0, 3)) if positions is None else positions, view.position)
        self._context.wait_for_frame(self._context.render([self._request], [self._read]))
        return self._picture[window.rows, window.columns].copy

    def find_light(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """Return the position (3,) [m] of the light that casts shadows."""
        return -FAR * np.array(KEY_DIRECTION)

    def close(self) -> None:
        """Free all that it holds, parts before the context that they belong to."""
        for part in ("_heap", "_request", "_read", "_target", "_key", "_parts", "_resources", "_scene", "_context"):
            self.__dict__.pop(part, None)


class GrainMesh:
    """All visible grains as one mesh, which every picture uploads anew."""

    def __init__(self, api: Any, context: Any, scene: Any, grains: Grains) -> None:
        self._api, self._context = api, context
        self._crystals = Crystals(make_crystals(grains.count, grains.radius))
        usage, kind = api.VertexAttributeUsage, api.VertexAttributeType
        self._attributes = [api.VertexAttribute(usage=one, type=of) for one, of in (
            (usage.VERTEX_ATTRIBUTE_USAGE_POSITION, kind.VERTEX_ATTRIBUTE_TYPE_FLOAT3),
            (usage.VERTEX_ATTRIBUTE_USAGE_NORMAL, kind.VERTEX_ATTRIBUTE_TYPE_FLOAT3),
            (usage.VERTEX_ATTRIBUTE_USAGE_UV, kind.VERTEX_ATTRIBUTE_TYPE_FLOAT2))]  # its materials want all three
        self._capacity = 0
        self._drawn = context.create_renderable(api.RenderableParams(cast_shadow=True, receive_shadow=True))
        material = api.Material()
        material.color, material.metallic = [*grains.colour, 1.0], 0.0
        material.roughness, material.specular = GRAIN_ROUGHNESS, GRAIN_SPECULAR
        self._drawn.set_material(material)
        self._scene, self._is_shown = scene, False

    def place(self, positions: NDArray[np.floating], eye: NDArray[np.float64]) -> None:
        """Put grains at positions (n, 3) [m], seen from an eye (3,)."""
        corners, normals = self._crystals.show(positions, eye)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if self._is_shown != bool(len(corners)):  # a mesh without extent is refused
            (self._scene.remove_renderable if self._is_shown else self._scene.add_renderable)(self._drawn)
            self._is_shown = not self._is_shown
        if not self._is_shown:
            return
        if len(corners) > self._capacity:
            self._capacity = int(ROOM * len(corners))
            self._config = self._api.MeshConfig(
                max_vertices=self._capacity, max_indices=self._capacity, interleaved=False,
                index_type=self._api.IndexType.INDEX_TYPE_U32, attributes=self._attributes,
                primitive_type=self._api.MeshPrimitiveType.MESH_PRIMITIVE_TYPE_TRIANGLES)
            self._mesh = self._context.create_mesh(self._config)
        buffer = np.zeros(8 * self._capacity, np.float32)
        buffer[: corners.size] = corners.ravel()
        buffer[3 * self._capacity :][: normals.size] = normals.ravel()
        buffer[3 * self._capacity + normals.size : 6 * self._capacity].reshape(-1, 3)[:, 2] = 1.0
        indices = np.zeros(self._capacity, np.uint32)  # those beyond the grains make triangles without an area
        indices[: len(corners)] = np.arange(len(corners), dtype=np.uint32)
        data = self._api.MeshData(compute_bounds=True)
        data.set_vertices(self._config, buffer.tobytes())
        data.set_indices(self._config, indices.tobytes())
        self._mesh.upload(data)
        self._drawn.set_mesh(self._mesh, 0, self._capacity)


@lru_cache(maxsize=1)
def find_device() -> Device:
    """Return the device that Filament draws on; raise FilamentUnavailable.
    A process of its own tries: where there is no device, MuJoCo ends the one that asks."""
    if mujoco.mj_version() < 4_000_000:
        raise FilamentUnavailable(f"Filament needs MuJoCo 4, and {mujoco.__version__} is installed")
    for is_software in (False, True):
        script = ("from mujoco import mjrf; import mujoco.studio.window; mjrf.Context(mjrf.ContextConfig("
                  f"software_rendering={is_software}, graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN))")
        tried = subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=60, text=True)
        if not tried.returncode:
            importlib.import_module("mujoco.studio.window")  # it makes Filament's materials known
            named = DEVICE_LINE.search(tried.stdout + tried.stderr)
            return Device(is_software, named[1] if named else "Vulkan device without a name")
    raise FilamentUnavailable(f"Filament finds no Vulkan device. On Debian or Ubuntu run: {APT_COMMAND}")


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Keep what Filament writes of its devices out of a command's own output."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)

"""Pictures of a MuJoCo scene with its grains."""

import atexit
import contextlib
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageChops

from robosim.base.errors import RobosimError
from robosim.config.scene import RegionConfig
from robosim.rendering.grain_skin import Crystals, read_facets
from robosim.rendering.soft_shadows import Shadows
from robosim.rendering.views import View, Window

Array = NDArray[np.float64]

TARGET_MARK = "target_mark"
"""Body and geom of it."""
MARK_THICKNESS = 0.0015
"""Half thickness [m] of a mark on the table."""
SMOOTHING = 2
"""Samples along a pixel's edge."""
SHADE = 0.5
"""Share of a surface's light that the key light gives it, and a shadow takes."""
MAP_SHARE, MAP_SIZES = 0.625, (256, 900)
"""Side of the light's depth map by the height of a picture, and its least and largest [texels]."""
STRIP = 36
"""Rows of a picture that are shaded at once: their arrays stay in the processor's cache."""
SKY = (228.0, 233.0, 239.0), (204.0, 209.0, 216.0)
"""Colours of what is behind everything, at the top and at the bottom of a picture: RGB."""
MOST_GEOMS = 10_000
APT_COMMAND = "apt-get install -y --no-install-recommends libegl1 libgl1"


class RenderingUnavailable(RobosimError, RuntimeError):
    """No OpenGL context on this machine; the message says how to install one."""

    def __init__(self, cause: object) -> None:
        super().__init__(f"cannot draw without OpenGL ({cause}). On Debian or Ubuntu run: {APT_COMMAND} ; and leave "
                         "MUJOCO_GL unset or set it to egl before Python starts.")


class SceneRenderer:
    """Draws frames of one model, with its grains if it has a grain skin, which no other renderer can use then.
    width, height: in pixels. Raises RenderingUnavailable."""

    def __init__(self, model: mujoco.MjModel, grain_count: int, width: int = 1280, height: int = 720) -> None:
        self._model, self._size = model, (height, width)
        self._crystals = Crystals(read_facets(model, grain_count)) if grain_count else None
        sky = np.linspace(SKY[0], SKY[1], height)[:, None].astype(np.uint8)
        self._sky = Image.fromarray(np.repeat(sky, width, axis=1))
        self._map = int(np.clip(MAP_SHARE * height, *MAP_SIZES))
        self._gl, self._context = open_context(model, *(max(SMOOTHING * n, self._map) for n in (width, height)))
        self._free = weakref.finalize(self, free_context, self._gl, self._context)
        atexit.register(self._free)  # before MuJoCo ends EGL, unlike where another finalizer was made earlier
        self._scene = mujoco.MjvScene(model, MOST_GEOMS)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_SKYBOX):
            self._scene.flags[flag] = False
        # updates of the scene then leave the skin's vertices alone: they are overwritten anyway
        model.skin_vertnum[:], model.skin_facenum[:], model.skin_bonenum[:] = 0, 0, 0
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = (1, 1, 1, 0, 0, 0)  # without collision geoms
        self._option.sitegroup[:] = 0

    def draw(self, data: mujoco.MjData, positions: Array | None, camera: str | mujoco.MjvCamera) -> NDArray[np.uint8]:
        """Draw the picture (height, width, 3) of a camera of the model, or of a free one.
        positions (n, 3) [m]: of the grains. data: only its positions are used. n may be smaller than the skin's count;
        None draws no grains."""
        return self.begin(data, positions, camera)()

    def begin(self, data: mujoco.MjData, positions: Array | None, camera: str | mujoco.MjvCamera,
              window: Window | None = None) -> Callable[[], NDArray[np.uint8]]:
        """Begin a picture as `draw` does, or a part of it; return what finishes it, which another thread may call
        meanwhile."""
        eye = aim(self._model, data, camera)
        scene, window = self._scene, window or Window.whole(self._size)
        mujoco.mjv_updateScene(self._model, data, self._option, None, eye, mujoco.mjtCatBit.mjCAT_ALL, scene)
        view = View.of(scene)
        if self._crystals is not None:
            self._place_grains(self._crystals, np.empty((0, 3)) if positions is None else positions, view)
        self._gl.make_current()
        view.enter(scene, self._size, window)
        colours, depth = self._read(*(SMOOTHING * n for n in window.shape))
        light = self._light()
        if light is None:
            return partial(self._shade, window, colours, depth, view, None)
        if self._crystals is not None:
            scene.skinfacenum[0] //= 2  # enough for the shadows of grains, which are narrower than a shadow's edge
        light.enter(scene)
        return partial(self._shade, window, colours, depth, view, (light, self._read(self._map, self._map)[1]))

    def find_light(self, data: mujoco.MjData) -> NDArray[np.float64] | None:
        """Return the position (3,) [m] of the light that casts shadows, None without one."""
        aim(self._model, data, mujoco.MjvCamera())
        mujoco.mjv_updateScene(self._model, data, self._option, None, mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_STATIC,
                               self._scene)
        light = self._light()
        return None if light is None else light.position

    def _light(self) -> View | None:
        """Return the view from the scene's first light that casts shadows."""
        light = next((light for light in self._scene.lights[: self._scene.nlight] if light.castshadow), None)
        radius = self._model.vis.map.shadowscale * self._model.stat.extent
        return None if light is None else View.of_light(light, self._model.stat.center, radius)

    def _shade(self, window: Window, colours: NDArray[np.uint8], depths: NDArray[np.float32], view: View,
               light: tuple[View, NDArray[np.float32]] | None) -> NDArray[np.uint8]:
        """Return a part (height, width, 3) of the picture with shadows, fog and sky.
        colours, depths: of the part, with all samples. light: its view, and its depth buffer."""
        height, width = window.shape
        room, extent = self._model.vis.map, np.float32(self._model.stat.extent)
        shadows = None if light is None else Shadows(self._size, window, view, *light)
        share, cover = np.empty((2, height, width), np.uint8)
        for first in range(0, height, STRIP):
            rows = slice(first, first + STRIP)
            depth = depths[SMOOTHING * first : SMOOTHING * (first + STRIP)]
            distances = view.distance(depth[::SMOOTHING, ::SMOOTHING])
            fog = (distances / extent - room.fogstart) * np.float32(255.0 / (room.fogend - room.fogstart))
            fog = np.clip(fog, 0.0, 255.0, out=fog)
            surface = 255.0 - fog
            if shadows is not None and surface.any():
                surface *= 1.0 - SHADE * (1.0 - shadows.lit(distances, rows))
            if fog.any():
                empty = sum((depth[k::SMOOTHING, j::SMOOTHING] == 0.0).astype(np.float32)
                            for k in range(SMOOTHING) for j in range(SMOOTHING))
                fog = np.maximum(fog, empty * np.float32(255 / SMOOTHING**2))
            share[rows], cover[rows] = surface + 0.5, fog + 0.5
        share, cover = (Image.merge("RGB", 3 * [Image.fromarray(one)]) for one in (share, cover))
        sky = self._sky.crop((window.left, window.top, window.right, window.bottom))
        surfaces = ImageChops.multiply(Image.fromarray(colours).reduce(SMOOTHING), share)
        return np.asarray(ImageChops.add(surfaces, ImageChops.multiply(sky, cover)))

    def _read(self, height: int, width: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return colours (height, width, 3) and depths that the scene's camera sees; where it sees nothing, 0."""
        rectangle = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(rectangle, self._scene, self._context)
        picture, depth = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        mujoco.mjr_readPixels(picture, depth, rectangle, self._context)
        return picture[::-1], depth[::-1]

    def _place_grains(self, crystals: Crystals, positions: NDArray[np.floating], view: View) -> None:
        """Overwrite the skin, which update_scene places at the origin, with grains at positions (n, 3) [m]."""
        corners, normals = crystals.show(positions, view.position)
        # only the first vertices of the skin are filled, streamed and drawn
        self._scene.skinvert[: corners.size], self._scene.skinnormal[: normals.size] = corners.ravel(), normals.ravel()
        self._scene.skinvertnum[0], self._scene.skinfacenum[0] = len(corners), len(corners) // 3

    def close(self) -> None:
        """Free the OpenGL context; also called when the last reference is gone, and at the interpreter's exit."""
        self._free()


def aim(model: mujoco.MjModel, data: mujoco.MjData, camera: str | mujoco.MjvCamera) -> mujoco.MjvCamera:
    """Bring what is drawn to the positions of data, and return a camera of the model by its name, or the free one."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    if not isinstance(camera, str):
        return camera
    eye = mujoco.MjvCamera()
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera(camera).id
    return eye


def add_mark(spec: mujoco.MjSpec, target: RegionConfig) -> None:
    """Add the target region to the picture: a flat mark on the table, a transparent box in the air."""
    flat = target.centre[2] - target.half[2] <= 0.0
    kind = mujoco.mjtGeom.mjGEOM_ELLIPSOID if target.round else mujoco.mjtGeom.mjGEOM_BOX
    body = spec.worldbody.add_body(name=TARGET_MARK,
                                   pos=[*target.centre[:2], MARK_THICKNESS if flat else target.centre[2]])
    body.add_geom(name=TARGET_MARK, type=kind, contype=0, conaffinity=0, mass=0,
                  size=[*target.half[:2], MARK_THICKNESS if flat else target.half[2]],
                  rgba=[0.20, 0.60, 0.35, 0.55 if flat else 0.12])


def open_context(model: mujoco.MjModel, width: int, height: int) -> tuple[Any, mujoco.MjrContext]:
    """Open an OpenGL context, and MuJoCo's for a model, for pictures of width x height pixels at most.
    Raises RenderingUnavailable."""
    if not hasattr(mujoco, "GLContext"):  # the case with MUJOCO_GL=disable
        raise RenderingUnavailable("MuJoCo was loaded without its GL modules")
    try:
        gl = mujoco.GLContext(width, height)
        gl.make_current()
        model.vis.global_.offwidth, model.vis.global_.offheight, model.vis.quality.offsamples = width, height, 0
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    except (mujoco.FatalError, ImportError, AttributeError, OSError, RuntimeError) as fault:
        raise RenderingUnavailable(fault) from fault
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
    return gl, context


def free_context(gl: Any, context: mujoco.MjrContext) -> None:
    """Free what `open_context` has opened."""
    with contextlib.suppress(Exception):  # current in another thread
        gl.make_current()  # else its objects' numbers would be freed in the context of another renderer
    context.free()
    gl.free()

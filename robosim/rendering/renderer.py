"""Pictures of a MuJoCo scene with its grains."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from robosim.base.errors import RobosimError
from robosim.config.scene import RegionConfig
from robosim.rendering.grain_skin import FACES, compute_normals, find_surface, read_facets
from robosim.rendering.soft_shadows import MAP_SIZE, View, shade

Array = NDArray[np.float64]

TARGET_MARK = "target_mark"
"""Body and geom of it."""
MARK_THICKNESS = 0.0015
"""Half thickness [m] of a mark on the table."""
SMOOTHING = 2
"""Samples along a pixel's edge."""
SHADE = 0.5
"""Share of a surface's light that the key light gives it, and a shadow takes."""
HEAP = 2.0
"""Weight of a heap's normal beside that of a grain's face."""
SKY = (228.0, 233.0, 239.0), (204.0, 209.0, 216.0)
"""Colours of what is behind everything, at the top and at the bottom of a picture: RGB."""
MOST_GEOMS = 10_000
CELL_IN_RADII = 4.0
"""Side of the cubes that find hidden grains, in radii: large enough that few inside a heap are empty by chance."""
APT_COMMAND = "apt-get install -y --no-install-recommends libegl1 libgl1"


class RenderingUnavailable(RobosimError, RuntimeError):
    """No OpenGL context on this machine; the message says how to install one."""

    def __init__(self, cause: object) -> None:
        super().__init__(f"cannot draw without OpenGL ({cause}). On Debian or Ubuntu run: {APT_COMMAND} ; and leave "
                         "MUJOCO_GL unset or set it to egl before Python starts.")


class SceneRenderer:
    """Draws frames of one model, with its grains if it has a grain skin.
    width, height: in pixels. Raises RenderingUnavailable."""

    def __init__(self, model: mujoco.MjModel, grain_count: int, width: int = 1280, height: int = 720) -> None:
        self._model, self._size = model, (height, width)
        self._facets = read_facets(model, grain_count)
        self._radius = float(np.linalg.norm(self._facets, axis=2).mean()) if grain_count else 0.0
        shape = (len(self._facets), len(FACES), 3, 3)
        self._normals = compute_normals(self._facets).astype(np.float32).reshape(shape)
        self._facets = self._facets.astype(np.float32).reshape(shape)
        a, b, c = np.moveaxis(self._facets, 2, 0)
        self._outward = np.cross(b - a, c - a)
        """Normals (n, 8, 3) of the faces, not of unit length."""
        self._gl, self._context = open_context(model, *(max(SMOOTHING * n, MAP_SIZE) for n in (width, height)))
        self._scene = mujoco.MjvScene(model, MOST_GEOMS)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_SKYBOX):
            self._scene.flags[flag] = False
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = (1, 1, 1, 0, 0, 0)  # without collision geoms
        self._option.sitegroup[:] = 0

    def draw(self, data: mujoco.MjData, positions: Array | None, camera: str | mujoco.MjvCamera) -> NDArray[np.uint8]:
        """Draw the picture (height, width, 3) of a camera of the model, or of a free one.
        positions (n, 3) [m]: of the grains. data: only its positions are used. n may be smaller than the skin's count;
        None draws no grains."""
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_camlight(self._model, data)
        eye = mujoco.MjvCamera() if isinstance(camera, str) else camera
        if isinstance(camera, str):
            eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self._model.camera(camera).id
        scene, (height, width) = self._scene, self._size
        mujoco.mjv_updateScene(self._model, data, self._option, None, eye, mujoco.mjtCatBit.mjCAT_ALL, scene)
        if len(self._facets):
            self._place_grains(np.empty((0, 3)) if positions is None else np.asarray(positions, np.float32))
        self._gl.make_current()
        view = View.of(scene)
        picture, depth = self._read(view, SMOOTHING * height, SMOOTHING * width)
        empty = np.asarray(Image.fromarray((depth == 0.0).view(np.uint8) * np.uint8(255)).reduce(SMOOTHING)) / \
            np.float32(255)
        colours = np.asarray(Image.fromarray(picture).reduce(SMOOTHING), np.float32)
        distances, room = view.distance(depth[::SMOOTHING, ::SMOOTHING]), self._model.vis.map
        extent = self._model.stat.extent
        fog = np.clip((distances / extent - room.fogstart) / (room.fogend - room.fogstart), 0.0, 1.0)
        share = 1.0 - fog
        light = next((light for light in scene.lights[: scene.nlight] if light.castshadow), None)
        if light is not None:
            seen_by = View.of_light(light, self._model.stat.center, room.shadowscale * extent)
            lit = shade(distances, view, seen_by, lambda view: self._read(view, MAP_SIZE, MAP_SIZE)[1])
            share *= 1.0 - SHADE * (1.0 - lit)
        rows = np.linspace(SKY[0], SKY[1], height, dtype=np.float32)[:, None]
        colours = colours * share[..., None]
        colours += np.maximum(empty, fog)[..., None] * rows
        return colours.astype(np.uint8)

    def _read(self, view: View, height: int, width: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return colours (height, width, 3) of a view, and its depth buffer, which is 0 where nothing is seen."""
        view.enter(self._scene)
        rectangle = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(rectangle, self._scene, self._context)
        picture, depth = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        mujoco.mjr_readPixels(picture, depth, rectangle, self._context)
        return picture[::-1], depth[::-1]

    def _place_grains(self, positions: NDArray[np.floating]) -> None:
        """Overwrite the skin, which update_scene places at the origin, with grains at positions (n, 3) [m]."""
        count = len(positions)
        if count > len(self._facets):
            raise ValueError(f"positions of {count} grains; accepted: at most {len(self._facets)}, as many as the "
                             f"scene's skin has")
        visible, outward = find_surface(positions, CELL_IN_RADII * self._radius)
        scene = self._scene
        # faces that look away from the camera are behind others of their grain
        sight = (View.of(scene).position - positions[visible]).astype(np.float32)
        grain, face = np.nonzero(np.einsum("nfd,nd->nf", self._outward[visible], sight) > 0.0)
        shown, used = visible[grain], 3 * len(grain)
        # only the first vertices of the skin are filled, streamed and drawn
        scene.skinvert[: 3 * used] = (self._facets[shown, face] + positions[shown, None]).ravel()
        scene.skinnormal[: 3 * used] = (self._normals[shown, face] + HEAP * outward[grain, None]).ravel()
        scene.skinvertnum[0], scene.skinfacenum[0] = used, len(grain)

    def close(self) -> None:
        """Free the OpenGL context; osmesa prints errors at interpreter exit otherwise."""
        self._context.free()
        self._gl.free()

    def __del__(self) -> None:
        if hasattr(self, "_gl"):
            self.close()


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

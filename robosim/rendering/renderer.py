"""Pictures of a MuJoCo scene with its grains."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from robosim.base.errors import RobosimError
from robosim.config.scene import RegionConfig
from robosim.rendering.grain_skin import FACES, compute_normals, find_hidden, read_facets

Array = NDArray[np.float64]

TARGET_MARK = "target_mark"
"""Body and geom of it."""
MARK_THICKNESS = 0.0015
"""Half thickness [m] of a mark on the table."""
CELL_IN_RADII = 3.0
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
        self._model = model
        self._facets = read_facets(model, grain_count)
        self._radius = float(np.linalg.norm(self._facets, axis=2).mean()) if grain_count else 0.0
        shape = (len(self._facets), len(FACES), 3, 3)
        self._normals = compute_normals(self._facets).astype(np.float32).reshape(shape)
        self._facets = self._facets.astype(np.float32).reshape(shape)
        a, b, c = np.moveaxis(self._facets, 2, 0)
        self._outward = np.cross(b - a, c - a)
        """Normals (n, 8, 3) of the faces, not of unit length."""
        self._renderer = open_renderer(model, width, height)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = (1, 1, 1, 0, 0, 0)  # without collision geoms
        self._option.sitegroup[:] = 0

    def draw(self, data: mujoco.MjData, positions: Array | None, camera: str | mujoco.MjvCamera,
             marked: NDArray[np.bool_] | None = None) -> NDArray[np.uint8]:
        """Draw the picture (height, width, 3) of a camera of the model, or of a free one.
        positions (n, 3) [m]: of the grains. data: only its positions are used. n may be smaller than the skin's count;
        None draws no grains. marked (n,): grains drawn with the second skin, which the model must have then."""
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_camlight(self._model, data)
        self._renderer.update_scene(data, camera, self._option)
        for geom in self._renderer.scene.geoms[: self._renderer.scene.ngeom]:
            if geom.rgba[3] < 1.0:  # decoration casts no shadow; that of a clear wall would be as dark as a solid one's
                geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        if len(self._facets):
            self._place_grains(np.empty((0, 3)) if positions is None else np.asarray(positions, np.float32), marked)
        return self._renderer.render()

    def _place_grains(self, positions: NDArray[np.floating], marked: NDArray[np.bool_] | None = None) -> None:
        """Overwrite the skins, which update_scene places at the origin, with grains at positions (n, 3) [m]."""
        count = len(positions)
        if count > len(self._facets):
            raise ValueError(f"positions of {count} grains; accepted: at most {len(self._facets)}, as many as the "
                             f"scene's skin has")
        visible = np.flatnonzero(~find_hidden(positions, CELL_IN_RADII * self._radius))
        scene = self._renderer.scene
        # faces that look away from the camera are behind others of their grain
        eye = 0.5 * (np.array(scene.camera[0].pos) + np.array(scene.camera[1].pos))
        sight = (eye - positions[visible]).astype(np.float32)
        grain, face = np.nonzero(np.einsum("nfd,nd->nf", self._outward[visible], sight) > 0.0)
        is_marked = np.zeros(len(grain), bool) if marked is None else marked[visible[grain]]
        for skin in range(self._model.nskin):
            chosen = np.flatnonzero(is_marked == bool(skin))
            shown, shown_face = visible[grain[chosen]], face[chosen]
            begin, used = 3 * int(scene.skinvertadr[skin]), 3 * len(chosen)
            # only the first vertices of a skin are filled, streamed and drawn
            vertices = self._facets[shown, shown_face] + positions[shown, None]
            scene.skinvert[begin : begin + 3 * used] = vertices.ravel()
            scene.skinnormal[begin : begin + 3 * used] = self._normals[shown, shown_face].ravel()
            scene.skinvertnum[skin], scene.skinfacenum[skin] = used, used // 3

    def close(self) -> None:
        """Free the OpenGL context; osmesa prints errors at interpreter exit otherwise."""
        self._renderer.close()


def apply_quality(spec: mujoco.MjSpec, shadow_size: int = 2048, samples: int = 0) -> None:
    """Set the shadow map's side in texels, the samples per pixel and a largest frame of 1920 x 1080.
    A software rasteriser takes about twice the time for 4 samples."""
    spec.visual.quality.shadowsize = shadow_size
    spec.visual.quality.offsamples = samples
    screen = getattr(spec.visual, "global")  # a Python keyword
    screen.offwidth, screen.offheight = 1920, 1080


def add_mark(spec: mujoco.MjSpec, target: RegionConfig) -> None:
    """Add the target region to the picture: a flat mark on the table, a transparent box in the air."""
    flat = target.centre[2] - target.half[2] <= 0.0
    kind = mujoco.mjtGeom.mjGEOM_ELLIPSOID if target.round else mujoco.mjtGeom.mjGEOM_BOX
    body = spec.worldbody.add_body(name=TARGET_MARK,
                                   pos=[*target.centre[:2], MARK_THICKNESS if flat else target.centre[2]])
    body.add_geom(name=TARGET_MARK, type=kind, contype=0, conaffinity=0, mass=0,
                  size=[*target.half[:2], MARK_THICKNESS if flat else target.half[2]],
                  rgba=[0.20, 0.60, 0.35, 0.55 if flat else 0.12])


def open_renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """Open an offscreen renderer of width x height pixels. Raises RenderingUnavailable."""
    if not hasattr(mujoco, "GLContext"):  # the case with MUJOCO_GL=disable
        raise RenderingUnavailable("MuJoCo was loaded without its GL modules")
    try:
        return mujoco.Renderer(model, height, width)
    except (mujoco.FatalError, ImportError, AttributeError, OSError, RuntimeError) as fault:
        raise RenderingUnavailable(fault) from fault

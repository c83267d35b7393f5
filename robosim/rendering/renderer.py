"""Pictures of a scene: MuJoCo draws the robot, and all grains as one skin that is overwritten frame by frame.

A skin is lit, shaded, shadowed and occluded like any other geometry, and its vertices are streamed to the GPU
(or to a software rasteriser) anyway. Each grain is a small octahedron of its own shape and attitude.
"""

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from robosim.config.scene import RegionConfig
from robosim.errors import RobosimError

Array = NDArray[np.float64]

GRAIN_SKIN = "grains"
MARK = 0.0015  # half thickness [m] of a mark on the table
GRAIN_RADIUS = 0.62  # of a drawn grain, in spacings of the grains: neighbours touch, so that a heap is closed
CELL_IN_RADII = 3.0  # large enough that few cubes inside a heap are empty by chance
APT_LINE = "apt-get install -y --no-install-recommends libegl1 libgl1"
CORNERS: Array = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
)  # outward, counter-clockwise
GRAIN_VERTICES = FACES.size  # no vertex is shared between faces, so that every facet keeps its own normal


class RenderingUnavailable(RobosimError, RuntimeError):
    """No OpenGL context can be made on this machine; the message says how to get one."""

    def __init__(self, cause: object) -> None:
        super().__init__(
            f"cannot draw without OpenGL ({cause}). On Debian or Ubuntu run: {APT_LINE} ; "
            "and leave MUJOCO_GL unset or set it to egl before Python starts."
        )


def crystals(count: int, radius: float, seed: int = 0) -> Array:
    """Return the facets (count, 24, 3) in m of octahedra about the origin with the given mean radius.

    Axes vary by 25 % and corners by 15 %, about the scatter of crushed crystals; attitudes are uniform.
    """
    rng = np.random.default_rng(seed)
    stretch = rng.uniform(0.75, 1.25, (count, 1, 3))
    corners = CORNERS * stretch + rng.uniform(-0.15, 0.15, (count, 6, 3))
    turned = np.einsum("nij,nkj->nki", random_rotations(rng, count), radius * corners)
    return turned[:, FACES.ravel()]


def random_rotations(rng: np.random.Generator, count: int) -> Array:
    """Return uniform random rotation matrices (count, 3, 3)."""
    w, x, y, z = (q := rng.normal(size=(4, count))) / np.linalg.norm(q, axis=0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def facet_normals(facets: Array) -> Array:
    """Return unit normals (n, 24, 3) per vertex for facets (n, 24, 3): half way between facet and sphere.

    Pure facet normals make a heap of white grains a black and white noise; a sphere's make it a heap of dots.
    """
    a, b, c = np.moveaxis(facets.reshape(-1, 3, 3), 1, 0)
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    radial = facets / np.linalg.norm(facets, axis=2, keepdims=True)
    normals = np.repeat(flat, 3, axis=0).reshape(facets.shape) + radial
    return normals / np.linalg.norm(normals, axis=2, keepdims=True)


def add_grain_skin(spec: mujoco.MjSpec, count: int, radius: float, rgba: ArrayLike) -> None:
    """Add a skin of grains, mean radius in m, colour rgba (4,), on a static body at the world's origin."""
    if count < 1 or radius <= 0.0:
        raise ValueError(f"grain skin: count {count} and radius {radius} m must both be positive")
    vertices = count * GRAIN_VERTICES
    spec.worldbody.add_body(name=GRAIN_SKIN)
    spec.add_skin(
        name=GRAIN_SKIN, rgba=np.asarray(rgba, float).tolist(), vert=crystals(count, radius).ravel().tolist(),
        face=list(range(vertices)), bodyname=[GRAIN_SKIN], bindpos=[0.0, 0.0, 0.0],
        bindquat=[1.0, 0.0, 0.0, 0.0], vertid=[list(range(vertices))], vertweight=[[1.0] * vertices],
    )  # fmt: skip


def apply_quality(spec: mujoco.MjSpec, shadow_size: int = 2048, samples: int = 0) -> None:
    """Set the shadow map's side in texels and the samples per pixel; room for frames up to 1920 x 1080.

    On a software rasteriser 4 samples cost about twice the time of the default 0: for stills.
    """
    spec.visual.quality.shadowsize = shadow_size
    spec.visual.quality.offsamples = samples
    screen = getattr(spec.visual, "global")  # a keyword, hence no plain attribute
    screen.offwidth, screen.offheight = 1920, 1080


def add_mark(spec: mujoco.MjSpec, target: RegionConfig) -> None:
    """Draw where the material shall go: a region on the table as a mark, one in the air as a box to look through."""
    flat = target.centre[2] - target.half[2] <= 0.0
    kind = mujoco.mjtGeom.mjGEOM_ELLIPSOID if target.round else mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(name="target_mark", type=kind, contype=0, conaffinity=0, mass=0,
                            pos=[*target.centre[:2], MARK if flat else target.centre[2]],
                            size=[*target.half[:2], MARK if flat else target.half[2]],
                            rgba=[0.20, 0.60, 0.35, 0.55 if flat else 0.12])


def enclosed(positions: NDArray[np.floating], cell: float) -> NDArray[np.bool_]:
    """Tell which grains (n,) at positions (n, 3) in m cannot be seen: no cube around theirs is empty.

    cell is the cubes' side in m. Without grains inside heaps the picture is the same and half as expensive.
    """
    if not len(positions):
        return np.zeros(0, bool)
    index = np.floor(positions / cell).astype(np.int64)
    index -= index.min(axis=0) - 1
    shape = index.max(axis=0) + 2
    flat = np.ravel_multi_index(tuple(index.T), tuple(shape))
    number = np.bincount(flat, minlength=int(np.prod(shape))).reshape(shape)
    full = number > 0
    for axis in range(3):
        full = full & np.roll(full, 1, axis) & np.roll(full, -1, axis)
    return full.ravel()[flat]


class SceneRenderer:
    """Draws frames of one model, with its grains if it has a grain skin."""

    def __init__(self, model: mujoco.MjModel, grain_count: int, width: int = 1280, height: int = 720) -> None:
        self._model = model
        self._facets = grain_facets(model, grain_count)
        self._radius = float(np.linalg.norm(self._facets, axis=2).mean()) if grain_count else 0.0
        self._normals = facet_normals(self._facets).astype(np.float32)
        self._facets = self._facets.astype(np.float32)
        self._renderer = open_renderer(model, width, height)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = (1, 1, 1, 0, 0, 0)  # no collision primitives
        self._option.sitegroup[:] = 0

    def frame(self, data: mujoco.MjData, positions: Array | None, camera: str) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3) from the named camera, with grains at positions (n, 3) in m.

        data: of which the positions count. n may be smaller than the skin's count; the grains left over are not drawn.
        None draws no grain.
        """
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_camlight(self._model, data)
        self._renderer.update_scene(data, camera, self._option)
        if len(self._facets):
            self._place_grains(np.empty((0, 3)) if positions is None else np.asarray(positions, np.float32))
        return self._renderer.render()

    def _place_grains(self, positions: NDArray[np.floating]) -> None:
        """Overwrite the skin that update_scene has just laid out at the origin; positions (n, 3) in m."""
        count = len(positions)
        if count > len(self._facets):
            raise ValueError(f"{count} grains given, but the scene's skin has {len(self._facets)}")
        seen = np.flatnonzero(~enclosed(positions, CELL_IN_RADII * self._radius))
        scene, used = self._renderer.scene, len(seen) * GRAIN_VERTICES
        # Only the skin's front part is filled, streamed and drawn.
        scene.skinvert[: 3 * used] = (self._facets[seen] + positions[seen, None]).ravel()
        scene.skinnormal[: 3 * used] = self._normals[seen].ravel()
        scene.skinvertnum[0], scene.skinfacenum[0] = used, used // 3

    def close(self) -> None:
        """Free the OpenGL context; needed with osmesa, which complains at interpreter exit otherwise."""
        self._renderer.close()


def grain_facets(model: mujoco.MjModel, grain_count: int) -> Array:
    """Return the facets (grain_count, 24, 3) in m of the model's grains about the origin, from its skin."""
    if grain_count == 0:
        return np.empty((0, GRAIN_VERTICES, 3))
    if model.nskin != 1 or model.nskinvert != grain_count * GRAIN_VERTICES:
        raise ValueError(
            f"the model has {model.nskin} skins with {model.nskinvert} vertices; {grain_count} grains need "
            f"one with {grain_count * GRAIN_VERTICES}: call add_grain_skin(spec, {grain_count}, ...) first"
        )
    return np.array(model.skin_vert, float).reshape(grain_count, GRAIN_VERTICES, 3)


def open_renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """Return an offscreen renderer of width x height pixels, or raise RenderingUnavailable."""
    if not hasattr(mujoco, "GLContext"):  # so it is with MUJOCO_GL=disable
        raise RenderingUnavailable("MuJoCo was loaded without its GL modules")
    try:
        return mujoco.Renderer(model, height, width)
    except (mujoco.FatalError, ImportError, AttributeError, OSError, RuntimeError) as fault:
        raise RenderingUnavailable(fault) from fault

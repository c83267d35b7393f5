"""Depth pictures of a MuJoCo scene with its grains, without OpenGL; and the errors of real depth cameras."""

from typing import NamedTuple

import mujoco
import numpy as np

import mpm
from mpm.observers.depth_image import DepthImage, Lens, Parts
from robosim.base.errors import UnknownName
from robosim.rendering.body_shapes import can_move, shown_meshes
from robosim.rendering.grain_skin import make_crystals

TO_IMAGE = np.diag([1.0, -1.0, -1.0])
"""From a MuJoCo camera's axes (y up, looks along -z) to those of its picture (y down, looks along z)."""


class DepthNoise(NamedTuple):
    """A camera that measures depth z by disparity: focal length x baseline / z."""

    focal: float
    """Of the real camera [pixels], whatever the size of the picture here."""
    baseline: float
    """Distance [m] between its two views, or between projector and view."""
    subpixel: float
    """Step of the disparity [pixels]."""
    constant: float
    """Standard deviation [m] at the distance `best`."""
    growth: float
    """What is added to it per (z - best)^2 [1/m]."""
    best: float
    """Distance [m] with the least noise."""
    nearest: float
    """Smallest depth [m] that is measured."""

    def apply(self, depth: np.ndarray, columns_focal: float, rng: np.random.Generator) -> np.ndarray:
        """Return a measured depth [m] (height, width); zero where there is none.
        depth: the exact one, infinite where nothing is seen. columns_focal: focal length of the picture [pixels]."""
        is_seen = np.isfinite(depth) & (depth >= self.nearest) & ~self.shadows(depth, columns_focal)
        z = np.where(is_seen, depth, 1.0)
        noisy = z + (self.constant + self.growth * (z - self.best) ** 2) * rng.standard_normal(z.shape)
        disparity = self.focal * self.baseline / np.maximum(noisy, 1e-3)
        steps = np.maximum(np.round(disparity / self.subpixel), 1.0)
        return np.where(is_seen, self.focal * self.baseline / (steps * self.subpixel), 0.0)

    def shadows(self, depth: np.ndarray, columns_focal: float) -> np.ndarray:
        """Return which pixels (height, width) the second view, on the right, cannot see past a nearer surface."""
        columns = np.arange(depth.shape[1]) - columns_focal * self.baseline / depth
        later = np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
        hidden = np.zeros(depth.shape, bool)
        hidden[:, :-1] = columns[:, :-1] > later[:, 1:]
        return hidden


NOISE = {
    # Kinect v1: axial noise of Nguyen, Izadi and Lovell (3DIMPVT 2012, eq. 2); focal length, baseline and step of
    # disparity of Khoshelham and Elberink (Sensors 12, 2012)
    "structured_light": DepthNoise(580.0, 0.075, 0.125, 0.0012, 0.0019, 0.4, 0.5),
    # RealSense D435 at 848 x 480: 90 deg wide, baseline 50 mm, steps of 1/32 pixel of disparity (Grunnet-Jepsen et al.,
    # "Subpixel linearity improvement for Intel RealSense depth camera D400 series", 2019). Assumed: noise of 0.08
    # pixels, which is 0.08 z^2 / (f b)
    "stereo": DepthNoise(424.0, 0.050, 1.0 / 32.0, 0.0, 0.08 / (424.0 * 0.050), 0.0, 0.20),
}
"""Name -> camera; distances that it cannot measure are zero."""


def find_noise(name: str | None) -> DepthNoise | None:
    """Return a camera's noise by name; None: exact. Raises UnknownName."""
    if name is None or name == "none":
        return None
    if name not in NOISE:
        raise UnknownName("noise of a depth camera", name, [*NOISE, "none"])
    return NOISE[name]


class DepthCamera:
    """A camera of a model, which sees what films show of its bodies, and grains.
    camera: its name. width, height: of its picture in pixels. grains: their number; radius: mean radius [m] with which
    they are drawn, as in films. Raises UnknownName for a camera that the model does not have."""

    def __init__(self, model: mujoco.MjModel, camera: str, width: int, height: int, grains: int, radius: float) -> None:
        names = [model.camera(k).name for k in range(model.ncam)]
        if camera not in names:
            raise UnknownName("camera", camera, names)
        self.model, self._camera = model, model.camera(camera).id
        self.lens = Lens.from_fovy(width, height, float(model.cam_fovy[self._camera]))
        self._image = DepthImage(self.lens)
        crystals = make_crystals(grains, radius)
        self._facets = np.ascontiguousarray(crystals, np.float32).reshape(grains, -1, 3, 3)
        self._radius = float(np.linalg.norm(crystals, axis=-1).max())
        moving = can_move(model)
        self._still, self._moving = (read_triangles(model, moving == flag) for flag in (False, True))
        self._is_fixed = not moving[model.cam_bodyid[self._camera]]
        self._background: np.ndarray | None = None

    def forget(self) -> None:
        """Draw what cannot move anew: it has been put elsewhere."""
        self._background = None

    def look(self, data: mujoco.MjData) -> mpm.Pose:
        """Return the camera's pose for data's joints and mocap bodies: axes x right, y down, z forward."""
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_camlight(self.model, data)
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, (data.cam_xmat[self._camera].reshape(3, 3) @ TO_IMAGE).ravel())
        return mpm.Pose(data.cam_xpos[self._camera].copy(), quaternion)

    def depth(self, data: mujoco.MjData, pose: mpm.Pose, grains: np.ndarray) -> np.ndarray:
        """Return the depth [m] along the optical axis (height, width), float32; infinite where nothing is seen.
        pose: what `look` returned for the same data. grains (n, 3 or more), float32: their positions [m]."""
        R, frames = pose.matrix.T, np.empty((self.model.nbody, 12))
        frames[:, :9] = (R @ data.xmat.reshape(-1, 3, 3)).reshape(-1, 9)
        frames[:, 9:] = (data.xpos - pose.position) @ R.T
        if self._background is None or not self._is_fixed:
            self._background = self._image.empty()
            self._image.draw_parts(self._still, frames, self._background)
        depth = self._background.copy()
        self._image.draw_parts(self._moving, frames, depth)
        world = np.concatenate([R.ravel(), -R @ pose.position])
        self._image.draw_grains(grains, self._facets, world, self._radius, depth)
        return depth

    def points(self, depth: np.ndarray, pose: mpm.Pose) -> np.ndarray:
        """Return the points [m] (height, width, 3) of the world that a depth picture shows."""
        lens = self.lens
        columns = (np.arange(lens.width) + 0.5 - lens.cx) / lens.fx
        rows = (np.arange(lens.height) + 0.5 - lens.cy) / lens.fy
        rays = np.stack(np.broadcast_arrays(columns[None], rows[:, None], 1.0), axis=-1)
        return pose.apply((rays * depth[..., None]).reshape(-1, 3)).reshape(*depth.shape, 3)


def read_triangles(model: mujoco.MjModel, chosen: np.ndarray) -> Parts:
    """Return the triangles of what is drawn of the bodies chosen (nbody,); each body is a part."""
    triangles, bodies = [np.zeros((0, 3, 3))], [np.zeros(0, int)]
    for _, body, mesh in shown_meshes(model, exact=True):
        if chosen[body]:
            triangles.append(np.asarray(mesh.triangles))
            bodies.append(np.full(len(mesh.faces), body))
    return Parts(np.concatenate(triangles), np.concatenate(bodies), model.nbody)

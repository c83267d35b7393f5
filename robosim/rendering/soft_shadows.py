"""Soft shadows, computed from the depths that the light and the camera see.
The shadow map of OpenGL has hard, stepped edges and doubles the time of a frame on a software rasteriser."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[np.float32]

FINER = 2
"""Steps in which a shadow's edge passes from one texel of the light's depth map to the next."""
PENUMBRA = 0.008
"""Half width of a shadow's edge [m]."""
SHARPNESS, EXPONENT = 80.0, 80.0
"""Of the shadow test [1/m]: a surface 1 / SHARPNESS behind another has a third of its light; and the largest exponent
in single precision."""
BIAS, FADE = 0.007, 8.0
"""Depth [m] behind a surface that counts as on it, and steepness with which shadows end at the map's edge."""


class View(NamedTuple):
    """A perspective camera: position and axes (rows: right, up, forward); top: of the frustum, at its near plane."""

    position: np.ndarray
    axes: np.ndarray
    near: float
    far: float
    top: float

    @staticmethod
    def of(scene: mujoco.MjvScene) -> "View":
        """Return the camera of a scene: the middle between its two eyes."""
        eye, other = scene.camera[:2]
        axes = np.stack([np.cross(eye.forward, eye.up), eye.up, eye.forward])
        return View(0.5 * (eye.pos + other.pos), axes, eye.frustum_near, eye.frustum_far, eye.frustum_top)

    @staticmethod
    def of_light(light: Any, centre: np.ndarray, radius: float) -> "View":
        """Return the view from a light of a sphere [m]; a directional light is far away."""
        is_near = light.type == mujoco.mjtLightType.mjLIGHT_SPOT
        eye = np.array(light.pos, float) if is_near else centre - 8.0 * radius * np.array(light.dir, float)
        distance = float(np.linalg.norm(centre - eye))
        up, _, forward = np.linalg.qr(np.stack([centre - eye, *np.eye(3)[:2]], 1))[0].T[[1, 2, 0]]
        forward = forward * np.sign(forward @ (centre - eye))
        near = max(distance - 1.5 * radius, 0.05 * distance)
        return View(eye, np.stack([np.cross(forward, up), up, forward]), near, distance + 1.5 * radius,
                    near * radius / distance)

    def enter(self, scene: mujoco.MjvScene) -> None:
        """Make it the camera of a scene."""
        for eye in scene.camera[:2]:
            eye.pos[:], eye.forward[:], eye.up[:] = self.position, self.axes[2], self.axes[1]
            eye.frustum_near, eye.frustum_far, eye.frustum_center = self.near, self.far, 0.0
            eye.frustum_top, eye.frustum_bottom = self.top, -self.top

    def distance(self, buffer: Array) -> Array:
        """Return depths [m] along the axis from a depth buffer that is 1 at the near plane and 0 at the far one."""
        return self.near * self.far / (self.near + buffer * np.float32(self.far - self.near))


class Shadows:
    """Shadows of one light in one picture.
    shape: height and width of the picture. texels: the depth buffer (n, n) of the light."""

    def __init__(self, shape: tuple[int, int], camera: View, light: View, texels: Array) -> None:
        size, count = np.float32(light.top / light.near), len(texels)
        middle = np.float32(0.5 * (light.near + light.far))
        seen = np.exp(np.clip(SHARPNESS * (light.distance(texels) - middle), -EXPONENT, EXPONENT))
        width = max(1, round(PENUMBRA * count / float(size * middle)))
        for axis in (0, 1):  # not by running sums, which lose all digits of the small
            seen = sum((np.roll(seen, shift, axis) for shift in range(1 - width, width)), np.zeros_like(seen))
        finer = Image.fromarray(seen).resize((FINER * count, FINER * count), Image.Resampling.BILINEAR)
        self._blocked = np.log(np.asarray(finer) / (2 * width - 1) ** 2) / np.float32(SHARPNESS) + middle
        self._size = size
        self._turn = (light.axes @ camera.axes.T).astype(np.float32)
        self._start = (light.axes @ (camera.position - light.position)).astype(np.float32)
        self._up, self._right = (np.float32(camera.top / camera.near / shape[0]) *
                                 np.arange(1 - n, n, 2, dtype=np.float32) for n in shape)

    def lit(self, depth: Array, rows: slice) -> Array:
        """Return the share of the light (n, width) that reaches what a camera sees in some rows.
        depth (n, width): [m] along the camera's axis."""
        x, y, z = (depth * (self._right * a + (c - self._up[rows] * b)[:, None]) + s
                   for (a, b, c), s in zip(self._turn, self._start))
        scale, last = 1.0 / (z * self._size), len(self._blocked) - 1
        column, row = x * scale, y * scale
        texel = [np.clip((1.0 + share) * np.float32(0.5 * (last + 1)), 0, last).astype(np.int32)
                 for share in (-row, column)]
        z -= np.float32(BIAS)
        lit = np.exp(np.minimum(np.float32(SHARPNESS) * (self._blocked[texel[0], texel[1]] - z), 0.0))
        edge = np.clip(FADE * (1.0 - np.maximum(np.abs(column), np.abs(row))), 0.0, 1.0)
        return 1.0 - edge * (1.0 - lit)

"""Soft shadows, computed from the depths that the light and the camera see.
The shadow map of OpenGL has hard, stepped edges and doubles the time of a frame on a software rasteriser."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from robosim.rendering.views import View, Window

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


class Shadows:
    """Shadows of one light in a part of a picture.
    shape: height and width of the whole picture. texels: the depth buffer (n, n) of the light."""

    def __init__(self, shape: tuple[int, int], window: Window, camera: View, light: View, texels: Array) -> None:
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
        pixel = np.float32(camera.top / camera.near / shape[0])
        self._up, self._right = (pixel * np.arange(1 - n, n, 2, dtype=np.float32)[part]
                                 for n, part in zip(shape, (window.rows, window.columns)))

    def lit(self, depth: Array, rows: slice) -> Array:
        """Return the share of the light (n, width) that reaches what a camera sees in some rows of the part.
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

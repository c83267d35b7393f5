"""Perspective cameras, and parts of the pictures that they see."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]


class Window(NamedTuple):
    """A part of a picture: from the row `top` to before `bottom`, from the column `left` to before `right`."""

    top: int
    bottom: int
    left: int
    right: int

    @staticmethod
    def whole(shape: tuple[int, int]) -> "Window":
        """Return all of a picture of a shape (height, width)."""
        return Window(0, shape[0], 0, shape[1])

    @property
    def rows(self) -> slice:
        """Its rows in the picture."""
        return slice(self.top, self.bottom)

    @property
    def columns(self) -> slice:
        """Its columns in the picture."""
        return slice(self.left, self.right)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [pixels]."""
        return self.bottom - self.top, self.right - self.left

    def grow(self, room: int, shape: tuple[int, int]) -> "Window":
        """Return it with room [pixels] about it, as far as a picture of a shape (height, width) has it."""
        return Window(max(self.top - room, 0), min(self.bottom + room, shape[0]),
                      max(self.left - room, 0), min(self.right + room, shape[1]))


class Frustum(NamedTuple):
    """What a camera sees: centre of its width, lowest and highest place at the near plane [m]."""

    centre: float
    bottom: float
    top: float


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

    def enter(self, scene: mujoco.MjvScene, shape: tuple[int, int] | None = None, window: Window | None = None) -> None:
        """Make it the camera of a scene, or what it sees in a part of a picture of a shape."""
        frustum = self.frustum(shape, window) if shape and window else Frustum(0.0, -self.top, self.top)
        for eye in scene.camera[:2]:
            eye.pos[:], eye.forward[:], eye.up[:] = self.position, self.axes[2], self.axes[1]
            eye.frustum_near, eye.frustum_far, eye.frustum_center = self.near, self.far, frustum.centre
            eye.frustum_top, eye.frustum_bottom = frustum.top, frustum.bottom

    def frustum(self, shape: tuple[int, int], window: Window) -> "Frustum":
        """Return what a part of a picture of a shape (height, width) shows."""
        height, width = shape
        return Frustum(self.top / height * (window.left + window.right - width),
                       self.top * (1.0 - 2.0 * window.bottom / height), self.top * (1.0 - 2.0 * window.top / height))

    def is_same(self, other: "View") -> bool:
        """Whether another camera sees the same."""
        return all(np.array_equal(mine, its) for mine, its in zip(self, other))

    def locate(self, shape: tuple[int, int], points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and columns (n, 2) [pixels] of points (n, 3) [m] in a picture of a shape (height, width), and the
        pixels a metre (n,) there. Points must be in front of the near plane."""
        x, y, z = self.axes @ (points - self.position).T
        scale = 0.5 * shape[0] * self.near / (self.top * z)
        return np.stack([0.5 * shape[0] - y * scale, 0.5 * shape[1] + x * scale], 1), scale

    def distance(self, buffer: Array) -> Array:
        """Return depths [m] along the axis from a depth buffer that is 1 at the near plane and 0 at the far one."""
        return self.near * self.far / (self.near + buffer * np.float32(self.far - self.near))

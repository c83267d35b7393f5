"""Errors of depth cameras: noise that grows with distance, steps of disparity, and shadows beside edges."""

from typing import NamedTuple

import numpy as np

from robosim.base.errors import UnknownName


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

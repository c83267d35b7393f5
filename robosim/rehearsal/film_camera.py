"""A camera that keeps hand and tool in the picture."""

import mujoco
import numpy as np

DISTANCE, AZIMUTH_DEG, ELEVATION_DEG = 0.62, 205.0, -28.0
"""Of the camera from what it looks at [m], and its direction [deg]: from the other side of the table."""
LAG = 0.5
"""Time [s] in which the camera follows: a jerk of the hand does not shake the picture."""


class FollowCamera:
    """Looks at the middle between hand and tool, smoothly."""

    def __init__(self, model: mujoco.MjModel, hand: str, tool: str) -> None:
        self._tool, self._hand = model.body(tool).id, model.body(hand).id
        self._time: float | None = None
        self.camera = mujoco.MjvCamera()
        self.camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self.camera.distance, self.camera.azimuth, self.camera.elevation = DISTANCE, AZIMUTH_DEG, ELEVATION_DEG

    def follow(self, data: mujoco.MjData, time: float) -> mujoco.MjvCamera:
        """Return the camera at a time [s]; data: with positions of bodies."""
        aim = 0.4 * data.xpos[self._hand] + 0.6 * data.xpos[self._tool]
        share = 1.0 if self._time is None else 1.0 - np.exp(-max(time - self._time, 0.0) / LAG)
        self.camera.lookat[:] += share * (aim - self.camera.lookat)
        self._time = time
        return self.camera

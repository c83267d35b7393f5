"""The tool path of a task's scripted policy."""

import numpy as np
from scipy.spatial.transform import Rotation

import mpm


class ScriptedPath:
    """Tool poses over time, eased between waypoints.

    yaw_deg: constant yaw. times [s] (n,), rising, from 0 on. positions [m] (n, 3): of the tool's frame in the world.
    pitches_deg (n,). The orientation is R = Rz(yaw) Ry(pitch).
    """

    def __init__(self, yaw_deg: float, times: np.ndarray, positions: np.ndarray, pitches_deg: np.ndarray) -> None:
        self._yaw, self._times, self._positions, self._pitches = yaw_deg, times, positions, pitches_deg

    def pose(self, time: float) -> mpm.Pose:
        """Return the tool's pose at a time [s]; after the last waypoint it stays there."""
        k = min(max(int(np.searchsorted(self._times, time)), 1), len(self._times) - 1)
        u = np.clip((time - self._times[k - 1]) / (self._times[k] - self._times[k - 1]), 0.0, 1.0)
        u = u * u * (3.0 - 2.0 * u)  # at rest in every waypoint
        position = (1 - u) * self._positions[k - 1] + u * self._positions[k]
        pitch = (1 - u) * self._pitches[k - 1] + u * self._pitches[k]
        rotation = Rotation.from_euler("ZY", (self._yaw, pitch), degrees=True)
        return mpm.Pose(position, rotation.as_quat(scalar_first=True))

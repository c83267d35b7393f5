"""What the frames of a recording have besides grains, over time."""

import numpy as np

from robosim.recordings.reader import Recording


class History:
    """Times, curves, positions of the tool and forces on it, of all frames that were read."""

    def __init__(self, recording: Recording) -> None:
        self._recording, header = recording, recording.header
        self._tool = next((k for k, body in enumerate(header.moving) if body.name == header.tool), None)
        self.times = np.zeros(0)
        """(frames,) [s]"""
        self.values = np.zeros((0, len(header.curves)))
        """(frames, curves)"""
        self.tool_positions = np.zeros((0, 3))
        """(frames, 3) [m]; zero without a tool."""
        self.forces = np.zeros((0, 3))
        """(frames, 3) [N] of the grains on the tool."""

    @property
    def largest_force(self) -> float:
        """[N]"""
        return float(np.linalg.norm(self.forces, axis=1).max()) if len(self.forces) else 0.0

    def refresh(self) -> bool:
        """Read the frames that were added; return whether there were any."""
        new = [self._recording.scene(k) for k in range(len(self.times), len(self._recording))]
        if not new:
            return False
        places = [np.zeros(3) if self._tool is None else r.poses[self._tool, :3] for r in new]
        self.times = np.append(self.times, [r.time for r in new])
        self.values = np.concatenate([self.values, [r.values for r in new]])
        self.tool_positions = np.concatenate([self.tool_positions, places])
        self.forces = np.concatenate([self.forces, [r.wrench[:3] for r in new]])
        return True

    def nearest(self, time: float) -> int:
        """Return the frame whose time [s] is nearest."""
        k = int(np.clip(np.searchsorted(self.times, time), 1, max(len(self.times) - 1, 1)))
        return k if k < len(self.times) and abs(self.times[k] - time) < abs(self.times[k - 1] - time) else k - 1

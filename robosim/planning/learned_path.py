"""Learned motions in sequence as a path that the arm can follow.

Each motion begins where the one before ends, levelled and at its own start height. Learned motions change their speed
abruptly every 20 ms: they are smoothed by a moving average, shifted away from containers, and time-scaled where the arm
needs it.
"""

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.spatial.transform import Rotation, Slerp

from mpm.geometry.rigid_motion import Pose
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.learned_motions import load_sequence
from robosim.planning.pose_sequences import (
    SAMPLING,
    SMOOTHING,
    PoseSequence,
    align_signs,
    check_duration,
    connect,
    restore_clearance,
    smooth,
)
from robosim.scene.container_clearance import ContainerSurface

WEIGHING_TIME = 0.5
"""Time [s] at rest where the load is weighed."""
SCALING_WINDOW = 0.1
"""[s] around a moment that is too fast which are slowed down with it."""
SEARCH_WINDOW = 0.5
"""[s] before and after a moment within which the nearest point of a path is searched."""


class LearnedPath:
    """Tool poses over time along the learned motions of a rehearsal, in world axes."""

    def __init__(self, config: RehearsalConfig) -> None:
        raw, self._host_dt = _RawPath(config), config.host_dt
        self._marks, self._rest_samples = raw.marks, raw.rests
        self._raw = raw.join()
        self.clearance_shift = 0.0
        """Largest distance [m] by which the path was shifted away from containers."""
        if config.containers:
            positions = restore_clearance(ContainerSurface(config), self._raw)
            self.clearance_shift = float(np.linalg.norm(positions - self._raw.positions, axis=1).max())
            self._raw = PoseSequence(positions, self._raw.quaternions)
        self._step_times = np.full(len(self._raw.positions) - 1, SAMPLING)
        """Time [s] between the raw poses (n - 1,)."""
        self._resample()

    def _resample(self) -> None:
        """Sample the path again with the present step times, and smooth it."""
        raw_times = np.concatenate([[0.0], np.cumsum(self._step_times)])
        check_duration(float(raw_times[-1]), self._host_dt, f"{len(raw_times)} poses of learned motions, slowed down "
                       f"to the arm's limits")
        times = np.linspace(0.0, raw_times[-1], round(raw_times[-1] / SAMPLING) + 1)
        positions, quaternions = [
            np.column_stack([np.interp(times, raw_times, column) for column in values.T]) for values in self._raw]
        self._positions, self._step, self.duration = smooth(positions), times[1], float(times[-1])
        self._rotations = Slerp(times, Rotation.from_quat(smooth(quaternions), scalar_first=True))
        self._raw_times, self._times = raw_times, times
        self.times = {name: float(raw_times[k]) for name, k in self._marks.items()}
        """Motion -> time [s] of its start; "end" -> end of the last."""
        self.rests = {name: (float(raw_times[a]), float(raw_times[b])) for name, (a, b) in self._rest_samples.items()}
        """Waypoint -> first and last time [s] at rest there."""
        self.smoothing_deviation = float(np.linalg.norm(self._positions - positions, axis=1).max())
        """Largest distance [m] between the path before and after smoothing."""
        self.time_scale = float(self.duration / (SAMPLING * len(self._step_times)))
        """Duration over that of the learned motions, rests included."""

    def slow_down(self, times: np.ndarray, factors: np.ndarray) -> None:
        """Scale the time about `times` [s] (n,) of the present path by factors (n,).

        Factors below 1 count as 1.
        """
        window = max(1, round(SCALING_WINDOW / (times[1] - times[0])))
        scale = maximum_filter1d(np.maximum(factors, 1.0), window)
        midpoints = 0.5 * (self._raw_times[1:] + self._raw_times[:-1])
        self._step_times = self._step_times * np.interp(midpoints, times, scale)
        self._resample()

    def pose(self, time: float) -> Pose:
        """Return the tool's world pose at a time [s]."""
        time = min(max(time, 0.0), self.duration)
        position = np.array([np.interp(time, self._times, column) for column in self._positions.T])
        return Pose(position, self._rotations(time).as_quat(scalar_first=True))

    def sample_near(self, time: float, tip: np.ndarray) -> np.ndarray:
        """Sample positions (n, 6) [m] of the path about a time [s].

        Of the tool's origin and of a point `tip` (3,) [m] of its frame.
        """
        moments = np.arange(time - SEARCH_WINDOW, time + SEARCH_WINDOW, 2 * self._step)
        index = np.clip(np.rint(moments / self._step).astype(int), 0, len(self._times) - 1)
        positions = self._positions[index]
        return np.hstack([positions, positions + self._rotations(self._times[index]).apply(tip)])


class _RawPath:
    """The motions of a rehearsal with connections and rests between them, before smoothing."""

    def __init__(self, config: RehearsalConfig) -> None:
        self._parts: list[PoseSequence] = []
        self._count = 0
        self.marks: dict[str, int] = {}
        """Motion -> index of its first pose; "end" -> the last pose."""
        self.rests: dict[str, tuple[int, int]] = {}
        """Waypoint at which the load is weighed -> its first and last pose at rest."""
        for k, sub_task in enumerate(load_sequence(config)):
            motion = sub_task.poses
            self._append(connect(self._parts[-1], motion) if k else PoseSequence(*(v[:1] for v in motion)))
            self._rest(2 * SMOOTHING)
            if k > 0 or config.tool_fill_height is not None:
                self._weigh(config.weigh_at)
            self.marks[sub_task.name] = self._count
            self._append(motion)
            self._rest(2 * SMOOTHING)
        self._weigh(config.weigh_at)
        self.marks["end"] = self._count - 1

    def join(self) -> PoseSequence:
        """Return all poses; quaternions do not change their sign from one to the next."""
        return PoseSequence(np.concatenate([p.positions for p in self._parts]),
                            align_signs(np.concatenate([p.quaternions for p in self._parts])))

    def _append(self, part: PoseSequence) -> None:
        self._parts.append(part)
        self._count += len(part.positions)

    def _rest(self, duration: float) -> None:
        """Append the last pose for a time [s]."""
        self._append(PoseSequence(*(np.repeat(v[-1:], round(duration / SAMPLING), 0) for v in self._parts[-1])))

    def _weigh(self, waypoint: str | None) -> None:
        """Append a rest for weighing the load, once."""
        if waypoint is not None and not self.rests:
            self.rests[waypoint] = (self._count, self._count + round(WEIGHING_TIME / SAMPLING))
            self._rest(WEIGHING_TIME + 2 * SMOOTHING)

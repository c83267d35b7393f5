"""Recorded motions in sequence as a path that the arm can follow.
Each motion begins where the one before ends, levelled and at its own start height. Recorded motions change their speed
abruptly every 20 ms: they are smoothed by a moving average, shifted away from containers, which learning does not
include, and time-scaled where the arm needs it."""

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from mpm.geometry.rigid_motion import Pose
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.recorded_motions import SAMPLING, PoseSequence, load_sequence
from robosim.planning.waypoint_path import check_duration
from robosim.scene.container_clearance import ContainerSurface

SMOOTHING = 0.08
"""Window [s] of the moving average, which is applied twice."""
CONNECTION_SPEED, CONNECTION_ANGULAR_SPEED = 0.15, 0.8
"""Speeds [m/s], [rad/s] from the end of a motion to the start of the next."""
WEIGHING_TIME = 0.5
"""Time [s] at rest where the load is weighed."""
SCALING_WINDOW = 0.1
"""[s] around a moment that is too fast which are slowed down with it."""
SEARCH_WINDOW = 0.5
"""[s] before and after a moment within which the nearest point of a path is searched."""
CLEARANCE = 0.002
"""Least distance [m] of tool and containers: the largest tracking error that is accepted there."""
MAX_SHIFT = 0.01
"""[m] by which the tool is shifted at most; a path that would need more is left as it is."""
BLEND_TIME = 0.2
"""Time [s] over which a shift begins and ends."""
MAX_ITERATIONS = 8
"""Shifts of a path at most."""
CHECKED_SAMPLES = 10
"""Samples of the path from one check of the clearance to the next."""
SHIFT_TOLERANCE = 1e-4
"""Missing clearance [m] that is accepted at the end."""


class RecordedPath:
    """Tool poses over time along the recorded motions of a rehearsal, in world axes."""

    def __init__(self, config: RehearsalConfig) -> None:
        self.config, raw = config, _RawPath(config)
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
        check_duration(float(raw_times[-1]), self.config.host_dt, f"{len(raw_times)} poses of recorded motions, slowed "
                       f"down to the arm's limits")
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
        """Duration over that of the recorded motions, rests included."""

    def slow_down(self, times: np.ndarray, factors: np.ndarray) -> None:
        """Scale the time about `times` [s] (n,) of the present path by factors (n,); those below 1 count as 1."""
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
        """Sample places (n, 6) [m] of tool and `tip` (3,) [m], a point of its frame, about a time [s]."""
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
        positions, quaternions = (np.concatenate(values) for values in zip(*self._parts))
        flips = np.cumprod(np.where(np.sum(quaternions[1:] * quaternions[:-1], 1) < 0, -1.0, 1.0))
        return PoseSequence(positions, quaternions * np.concatenate([[1.0], flips])[:, None])

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


def connect(last: PoseSequence, following: PoseSequence) -> PoseSequence:
    """Connect the end of a sequence to the start of the next, straight and at constant speed."""
    begin, end = last.positions[-1], following.positions[0]
    rotations = Rotation.from_quat(np.stack([last.quaternions[-1], following.quaternions[0]]), scalar_first=True)
    angle = float((rotations[0].inv() * rotations[1]).magnitude())
    duration = max(float(np.linalg.norm(end - begin)) / CONNECTION_SPEED, angle / CONNECTION_ANGULAR_SPEED)
    share = np.linspace(0.0, 1.0, max(2, round(duration / SAMPLING)))
    return PoseSequence(begin + share[:, None] * (end - begin),
                        Slerp([0.0, 1.0], rotations)(share).as_quat(scalar_first=True))


def smooth(values: np.ndarray) -> np.ndarray:
    """Apply a moving average over SMOOTHING twice to samples (n, k); quaternions stay nearly of unit length."""
    size = 2 * round(0.5 * SMOOTHING / SAMPLING) + 1
    return uniform_filter1d(uniform_filter1d(values, size, axis=0, mode="nearest"), size, axis=0, mode="nearest")


def restore_clearance(surface: ContainerSurface, path: PoseSequence) -> np.ndarray:
    """Shift a path away from containers where it comes closer to them than CLEARANCE.
    Returns positions (n, 3) [m]; those of the path where MAX_SHIFT is not enough. Both the path and the smoothed path
    are checked: time scaling gives one between them."""
    original, quaternions = path
    smoothed_quaternions, positions = smooth(quaternions), original
    for _ in range(MAX_ITERATIONS):
        shift = compute_shifts(surface, PoseSequence(positions, quaternions))
        smoothed = compute_shifts(surface, PoseSequence(smooth(positions), smoothed_quaternions))
        is_longer = np.linalg.norm(smoothed, axis=1) > np.linalg.norm(shift, axis=1)
        shift[is_longer] = smoothed[is_longer]
        if np.linalg.norm(positions - original, axis=1).max() > MAX_SHIFT:
            break
        if np.linalg.norm(shift, axis=1).max() < SHIFT_TOLERANCE:
            return positions
        # blended so that they begin and end smoothly, and are nowhere smaller
        size = 2 * round(0.5 * BLEND_TIME / SAMPLING) + 1
        highest = maximum_filter1d(shift.clip(min=0.0), size, axis=0)
        lowest = minimum_filter1d(shift.clip(max=0.0), size, axis=0)
        positions = positions + uniform_filter1d(highest + lowest, size, axis=0, mode="nearest")
    return original


def compute_shifts(surface: ContainerSurface, path: PoseSequence) -> np.ndarray:
    """Compute displacements (n, 3) [m] that restore the clearance of every CHECKED_SAMPLES-th pose, zero for others."""
    shift = np.zeros_like(path.positions)
    for k in range(0, len(shift), CHECKED_SAMPLES):
        quaternion = path.quaternions[k] / np.linalg.norm(path.quaternions[k])
        shift[k] = surface.compute_displacement(Pose(path.positions[k], quaternion), CLEARANCE)
    return shift

"""Joint angles that the real arm recorded, as the motion of a rehearsal."""

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.optimize import minimize_scalar
from scipy.signal import butter, sosfiltfilt

from robosim.base.errors import ConfigError
from robosim.cell.drivers import LONGEST
from robosim.config.rehearsal import RehearsalConfig
from robosim.conversion.joint_log import JointLog
from robosim.conversion.joint_log_files import read_joint_log
from robosim.robot.model import Arm
from robosim.robot.ros_trajectory import name_joints
from robosim.robot.timing import JointMotion, JointState
from robosim.scene.build import assemble_rehearsal

RATE = 500.0
"""Samples per second that recorded angles are brought to."""
CUTOFF = 20.0
"""Frequency [Hz] above which recorded angles are taken as noise: arms' servos follow up to a few hertz."""
COARSE = 0.05
"""Step [s] of the search for the clocks' difference, which is then refined."""
SEARCH_RATE = 50.0
"""Samples per second that the search compares."""
FOLLOWS = 0.25
"""Largest rms distance of a recording from the plan, of the plan's from its own mean: beyond it is of another motion,
or at another speed."""
SMALLEST = 0.05
"""Size [rad] that a motion counts with at least: an arm that hardly moves is not asked for more than it can do."""
LACKING = 0.1
"""Time [s] of the planned motion that a recording may lack at either end."""
KEPT_AFTER = 1.0
"""Time [s] after the planned motion that is played."""


class RecordedMotion:
    """Recorded joint angles as a motion, which the servo is given in place of the planned one.
    log: of the arm; planned: the motion that it is compared with, from whose start time counts. is_own: whether it is
    a motion of its own, played from its first sample to its last, which follows no plan. Raises ConfigError for angles
    beyond the joints' limits, and for a recording of something else."""

    delay = 0.0
    """Of the limits: none."""

    def __init__(self, log: JointLog, planned: JointMotion, arm: Arm, config: RehearsalConfig,
                 is_own: bool = False) -> None:
        self.log, self.planned, self.is_own = log, planned, is_own
        times, angles = log.joints
        self._rest = np.zeros(angles.shape[1])
        beyond = np.maximum(arm.lower - angles, angles - arm.upper)
        row, joint = np.unravel_index(np.argmax(beyond), beyond.shape)
        if beyond[row, joint] > 0.0:
            name = name_joints(arm.joints, config.joint_trajectory)[joint]
            raise ConfigError(f"{log.path}: joint {name} is at {angles[row, joint]:.4f} rad at {times[row]:.3f} s; "
                              f"accepted: {arm.lower[joint]:.4f} to {arm.upper[joint]:.4f} rad")
        if is_own and times[-1] - times[0] > LONGEST:
            raise ConfigError(f"{log.path}: {times[-1] - times[0]:.2f} s long; accepted: up to {LONGEST:g} s")
        if not is_own and times[-1] - times[0] < planned.duration - 2.0 * LACKING:
            raise ConfigError(f"{log.path}: {times[-1] - times[0]:.2f} s long; accepted: the whole planned motion of "
                              f"{planned.duration:.2f} s")
        grid = np.arange(times[0], times[-1], 1.0 / RATE)
        even = CubicSpline(times, angles)(grid)
        filtered = sosfiltfilt(butter(2, CUTOFF, fs=RATE, output="sos"), even, axis=0, padlen=min(60, len(grid) - 1))
        self.offset, apart = (float(times[0]), 0.0) if is_own else find_offset(grid, filtered, planned)
        """Time of the recording's clock at the start of the motion [s]."""
        if apart > FOLLOWS:
            raise ConfigError(f"{log.path}: does not follow the planned motion: at best its joints are {apart:.0%} of "
                              f"the motion's own size (rms) from it; accepted: up to {FOLLOWS:.0%}, a recording of "
                              f"this motion at its speed")
        self._spline = make_interp_spline(grid - self.offset, filtered, k=5)
        self._begin, end = float(grid[0] - self.offset), float(grid[-1] - self.offset)
        if not is_own and (self._begin > LACKING or end < planned.duration - LACKING):
            raise ConfigError(f"{log.path}: has {self._begin:.2f} to {end:.2f} s of the planned motion; accepted: all "
                              f"of it, 0 to {planned.duration:.2f} s")
        self.duration = end if is_own else min(end, planned.duration + KEPT_AFTER)

    def state(self, time: float) -> JointState:
        """Return the joint state at a time [s] since the planned motion's start; at rest before and after it."""
        inside = min(max(time, self._begin), self.duration)
        if inside != time:
            return JointState(self._spline(inside), self._rest, self._rest)
        return JointState(*(self._spline(time, nu=order) for order in range(3)))


def read_log(path: Path, config: RehearsalConfig, episode: int = 0) -> JointLog:
    """Read what the arm recorded; its joints are called as the exported trajectory calls them.
    episode: of a LeRobot dataset. Raises ConfigError."""
    names = name_joints(assemble_rehearsal(config).robot.joints, config.joint_trajectory)
    return read_joint_log(path, names, config.joint_trajectory.frame_id, episode)


def find_offset(times: np.ndarray, angles: np.ndarray, planned: JointMotion) -> tuple[float, float]:
    """Return the time [s] of a recording's clock at which the planned motion starts, and the rms distance there.
    times (n,) [s] in equal steps, angles (n, joints) [rad]. The distance is that during the planned motion, with the
    recording at rest before and after its samples, over the plan's distance from its own mean."""
    plan_times = np.arange(0.0, planned.duration, 1.0 / SEARCH_RATE)
    plan_angles = np.array([planned.state(t).q for t in plan_times])
    stride = max(1, round(RATE / SEARCH_RATE))
    reference = CubicSpline(times[::stride], angles[::stride])

    def distance(offset: float) -> float:
        at = np.clip(plan_times + offset, times[0], times[::stride][-1])
        return float(np.mean((reference(at) - plan_angles) ** 2))

    coarse = np.arange(times[0] - planned.duration, times[-1], COARSE)
    best = coarse[np.argmin([distance(offset) for offset in coarse])]
    found = minimize_scalar(distance, bounds=(best - COARSE, best + COARSE), method="bounded", options={"xatol": 1e-5})
    size = max(float(np.mean((plan_angles - plan_angles.mean(0)) ** 2)), SMALLEST**2)
    return float(found.x), float(np.sqrt(found.fun / size))  # pyright: ignore[reportAttributeAccessIssue]

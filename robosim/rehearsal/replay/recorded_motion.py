"""Joint angles that the real arm recorded, as the motion of a rehearsal."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.optimize import minimize_scalar
from scipy.signal import butter, sosfiltfilt

from robosim.config.rehearsal import RehearsalConfig
from robosim.conversion.joint_log import JointLog, read_joint_log
from robosim.errors import ConfigError
from robosim.robot.model import Arm
from robosim.robot.ros_trajectory import name_joints
from robosim.robot.timing import JointMotion, JointState

RATE = 500.0
"""Samples per second that recorded angles are brought to."""
CUTOFF = 20.0
"""Frequency [Hz] above which recorded angles are taken as noise: arms' servos follow up to a few hertz."""
ONSET = 5e-3
"""Angle [rad] of a joint from its start at which a motion has begun."""
SEARCH = 1.0
"""Time [s] about the equal onsets in which the clocks' difference is searched."""


class RecordedMotion:
    """Recorded joint angles as a motion, which the servo is given in place of the planned one.

    log: of the arm; planned: the motion that it is compared with, from whose start time counts. Raises ConfigError
    for angles beyond the joints' limits.
    """

    delay = 0.0
    """Of the limits: none."""

    def __init__(self, log: JointLog, planned: JointMotion, arm: Arm, names: list[str]) -> None:
        times, angles = log.joints
        _check_limits(log, arm, names)
        grid = np.arange(times[0], times[-1], 1.0 / RATE)
        even = CubicSpline(times, angles)(grid)
        filtered = sosfiltfilt(butter(2, CUTOFF, fs=RATE, output="sos"), even, axis=0, padlen=min(60, len(grid) - 1))
        self.offset = find_offset(grid, filtered, planned)
        """Time of the recording's clock at the start of the planned motion [s]."""
        self._spline = make_interp_spline(grid - self.offset, filtered, k=5)
        self._begin = float(grid[0] - self.offset)
        self.duration = float(grid[-1] - self.offset)

    def state(self, time: float) -> JointState:
        """Return the joint state at a time [s] since the planned motion's start; at rest before and after it."""
        inside = min(max(time, self._begin), self.duration)
        if inside != time:
            return JointState(self._spline(inside), np.zeros(7), np.zeros(7))
        return JointState(*(self._spline(time, nu=order) for order in range(3)))


class Replay(NamedTuple):
    """A recording that is played."""

    log: JointLog
    planned: JointMotion
    motion: RecordedMotion


def read_log(path: Path, config: RehearsalConfig) -> JointLog:
    """Read what the arm recorded; its joints are called as the exported trajectory calls them. Raises ConfigError."""
    return read_joint_log(path, name_joints(config.joint_trajectory), config.joint_trajectory.frame_id)


def make_replay(log: JointLog, planned: JointMotion, arm: Arm, config: RehearsalConfig) -> Replay:
    """Return a recording of a planned motion as it is played. Raises ConfigError for angles beyond the limits."""
    return Replay(log, planned, RecordedMotion(log, planned, arm, name_joints(config.joint_trajectory)))


def find_offset(times: np.ndarray, angles: np.ndarray, planned: JointMotion) -> float:
    """Return the time [s] of a recording's clock at which the planned motion starts.

    times (n,) [s] in equal steps, angles (n, joints) [rad]. Where both have left their start by ONSET, and from there
    where their distance is least.
    """
    plan_times = np.arange(0.0, planned.duration, 1.0 / RATE)
    plan_angles = np.array([planned.state(t).q for t in plan_times])

    def onset(at: np.ndarray, values: np.ndarray) -> float:
        left = np.abs(values - values[0]).max(1) > ONSET
        return float(at[np.argmax(left)]) if left.any() else float(at[0])

    guess = onset(times, angles) - onset(plan_times, plan_angles)
    reference = CubicSpline(plan_times, plan_angles)

    def distance(offset: float) -> float:
        at = np.clip(times - offset, plan_times[0], plan_times[-1])
        return float(np.mean((reference(at) - angles) ** 2))

    coarse = guess + np.linspace(-SEARCH, SEARCH, 41)
    best = coarse[np.argmin([distance(offset) for offset in coarse])]
    step = coarse[1] - coarse[0]
    return float(minimize_scalar(distance, bounds=(best - step, best + step), method="bounded",
                                 options={"xatol": 1e-5}).x)  # pyright: ignore[reportAttributeAccessIssue]


def _check_limits(log: JointLog, arm: Arm, names: list[str]) -> None:
    """Raise ConfigError where a recorded angle is beyond its joint's limits."""
    times, angles = log.joints
    beyond = np.maximum(arm.lower - angles, angles - arm.upper)
    row, joint = np.unravel_index(np.argmax(beyond), beyond.shape)
    if beyond[row, joint] > 0.0:
        raise ConfigError(f"{log.path}: joint {names[joint]} is at {angles[row, joint]:.4f} rad at {times[row]:.3f} s; "
                          f"accepted: {arm.lower[joint]:.4f} to {arm.upper[joint]:.4f} rad")

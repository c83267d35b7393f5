"""Drivers of a rehearsal: what commands the joints, step by step; `DosingDriver` stands in a file of its own."""

import inspect
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import mpm
from robosim.base.errors import ConfigError, DriverFault
from robosim.robot.model import Arm
from robosim.robot.timing import JointMotion, JointState

LONGEST = 600.0
"""Duration [s] of a user's driver, as of a path."""
ROUNDING = 1e-6
"""Share of a joint's limit by which a command may exceed it: angles are differences of rounded numbers."""


class RobotState(NamedTuple):
    """What a user's driver reads at the start of a step."""

    time: float
    """Since the motion's start [s]."""
    q: np.ndarray
    """Measured joint angles (n,) [rad]."""
    qd: np.ndarray
    """Measured joint speeds (n,) [rad/s]."""
    tool: mpm.Pose
    """World pose of the tool's frame."""
    wrist: np.ndarray
    """Force [N] and torque [N m] (6,) of the arm on the hand, in world axes, one step ago."""
    planned: JointState
    """The planned motion's command at this time."""


class MotionDriver:
    """Commands a motion of the joints, planned or recorded, after the fingers have closed.
    start: simulated time [s] at which the motion begins. latency: by which commands arrive late [s]."""

    name = "plan"
    is_own = False
    """Whether it is a user's own, which need not follow the plan."""
    is_open_ended = False
    """Whether it decides while it runs when it is over."""
    delay = 0.0
    """Time [s] by which a dose has delayed the motion; 0 until that is over."""

    def __init__(self, motion: JointMotion, start: float, latency: float = 0.0) -> None:
        self.motion, self._start, self._latency = motion, start, latency

    @property
    def duration(self) -> float:
        """Simulated time [s] of the run, as far as it is known."""
        return self._start + self.motion.duration + self.delay

    def command(self, time: float) -> JointState:
        """Return the joints' command for the step from a simulated time [s] on."""
        return self.motion.state(self.motion_time(time) - self._latency)

    def motion_time(self, time: float) -> float:
        """Return the time [s] of the motion at a simulated time [s]; it rests while a dose runs."""
        return time - self._start

    def is_dosing_at(self, time: float) -> bool:
        """Return whether a dose, or what else plans by itself, decides the motion at a simulated time [s]."""
        return False

    def expected_duration(self, time: float) -> float:
        """Return the simulated time [s] of the run, if a dose that runs at a time ended then."""
        return self.duration


class ReplayDriver(MotionDriver):
    """Commands a recorded motion of its own, which follows no plan."""

    name, is_own = "recording", True

    def is_dosing_at(self, time: float) -> bool:
        return True


def plans_itself(own: Any) -> bool:
    """Return whether a user's driver has a method `begin`, and so plans by itself; `begin` may be a time of its own."""
    return not isinstance(own, type) and callable(getattr(own, "begin", None))


class OwnDriver(MotionDriver):
    """Commands what a user's object or function returns, and checks it before anything moves.

    own: a function of a `RobotState`, or an object with such a method `command`, and with a `duration` [s] where it is
    not that of the plan; one with a method `begin`, which the run calls with itself, plans by itself. It is called in
    every step from the motion's start on, and returns joint angles (n,) [rad] or a `JointState`. read: returns the
    robot's state, given the motion's time [s] and its command. dt: of a step [s].
    Raises ConfigError for what cannot be called."""

    is_own = True

    def __init__(self, own: Any, motion: JointMotion, start: float, latency: float, arm: Arm, dt: float,
                 read: Callable[[float, JointState], RobotState]) -> None:
        super().__init__(motion, start)
        self._own = getattr(own, "command", own)
        self.name: str = getattr(own, "__name__", type(own).__name__)
        if (refused := describe_refused(own, self._own)) is not None:
            raise ConfigError(f"driver = {refused}; accepted: a function of the robot's state, or an object with a "
                              f"method `command` of it")
        length = getattr(own, "duration", motion.duration)
        if not isinstance(length, float | int) or not 0.0 < length <= LONGEST:
            raise ConfigError(f"driver {self.name}: duration = {length!r} s; accepted: above 0, up to {LONGEST:g} s")
        self._length, self._arm, self._dt, self._read = float(length), arm, dt, read
        self._plans = plans_itself(own)
        self._last = motion.state(0.0).q
        self._sent: deque[JointState] = deque(maxlen=round(latency / dt) + 1)

    @property
    def duration(self) -> float:
        return self._start + self._length

    def is_dosing_at(self, time: float) -> bool:
        return self._plans

    def command(self, time: float) -> JointState:
        """Raise DriverFault for a command that cannot be followed: its time, what it is, and the limit."""
        since = self.motion_time(time)
        planned = self.motion.state(since)
        if since < -0.5 * self._dt:
            return planned
        target = self._check(self._own(self._read(since, planned)), since)
        self._last = target.q
        self._sent.append(target)
        return self._sent[0]

    def _check(self, given: Any, time: float) -> JointState:
        arm, n = self._arm, len(self._last)
        is_whole = isinstance(given, JointState)
        try:
            parts = np.array(given if is_whole else [given], float)
        except (TypeError, ValueError):
            parts = np.zeros(0)
        if parts.shape != (3 if is_whole else 1, n):
            is_list = isinstance(given, tuple | list) and not is_whole
            what = f"array of shape {given.shape}" if isinstance(given, np.ndarray) else " ".join(repr(given).split())
            what = f"{type(given).__name__} of length {len(given)}" if is_list else what[:80]
            raise DriverFault(self.name, time, f"commands {what}", f"joint angles ({n},) [rad] or a JointState of such")
        if not np.isfinite(parts).all():
            shown = (parts if is_whole else parts[0]).tolist()
            raise DriverFault(self.name, time, f"commands {shown}", "finite numbers")
        speed = (parts[0] - self._last) / self._dt
        for k, name in enumerate(arm.joints):
            if not arm.lower[k] <= parts[0][k] <= arm.upper[k]:
                raise DriverFault(self.name, time, f"commands joint {name} to {parts[0][k]:.4f} rad",
                                  f"{arm.lower[k]:.4f} to {arm.upper[k]:.4f} rad")
            most = arm.velocity[k] * (1.0 + ROUNDING)
            if not self._sent and abs(speed[k]) > most:
                raise DriverFault(
                    self.name, time, f"begins with joint {name} {abs(speed[k]) * self._dt:.4g} rad from where the arm "
                    f"stands", f"up to {arm.velocity[k] * self._dt:.4g} rad, which it can move in a step")
            if (fastest := max(abs(speed[k]), abs(parts[1][k]) if is_whole else 0.0)) > most:
                raise DriverFault(self.name, time, f"commands joint {name} at {fastest:.4g} rad/s",
                                  f"up to {arm.velocity[k]:.4g} rad/s")
        q, qd, qdd = parts if is_whole else (parts[0], speed, np.zeros(n))
        return JointState(np.asarray(q), np.asarray(qd), np.asarray(qdd))


def describe_refused(own: Any, command: Any) -> str | None:
    """Return what was given in place of a driver; None where its command can be called with a robot's state."""
    if isinstance(own, type) or not callable(command):
        return f"class {own.__name__}" if isinstance(own, type) else f"{own!r:.100}"
    try:
        inspect.signature(command).bind(None)
    except TypeError:
        return f"{getattr(command, '__qualname__', own)!s:.100}{inspect.signature(command)}"
    except ValueError:  # some functions of C have no signature
        pass
    return None

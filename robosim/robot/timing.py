"""Jerk-limited joint motion: Ruckig from state to state through knots of a joint path."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
from ruckig import InputParameter, Ruckig, RuckigError, Trajectory
from scipy.interpolate import make_interp_spline

from robosim.base.errors import ConfigError
from robosim.robot.model import MotionLimits

KNOT_SPACING = 0.04
"""[s] between knots."""
JERK_BISECTIONS = 14
"""Steps in the search for the smoothest motion between two knots: leaves 0.1 % on the jerk."""
MAX_DELAY = 0.01
"""[s] by which limits may delay a motion; above, it is refused, because waypoints' times would no longer hold."""


def _find_nearest(waypoint_times: dict[str, float], time: float) -> str:
    """Name of the waypoint that is passed closest to a time [s]."""
    return min(waypoint_times, key=lambda w: abs(waypoint_times[w] - time))


class JointState(NamedTuple):
    """Angles [rad], speeds [rad/s] and accelerations [rad/s^2], each (joints,)."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


class JointMotion(Protocol):
    """A motion of the joints over time."""

    duration: float
    """[s]"""
    delay: float
    """Time [s] by which limits delay its end."""

    def state(self, time: float) -> JointState:
        """Return the joint state at a time [s] since its start; at rest before and after it."""
        ...


def compute_time_scale(times: np.ndarray, q: np.ndarray, limits: MotionLimits) -> np.ndarray:
    """Compute the factors (n,) on time that put a motion at its limits.

    At these, speed, acceleration or jerk would be at its limit. q (n, joints): joint angles [rad] at `times` (n,) [s].
    Above 1 the motion is too fast.
    """
    spline = make_interp_spline(times, q, k=5)
    shares = [(np.abs(spline.derivative(k)(times)) / most).max(1) ** (1.0 / k) for k, most in enumerate(limits, 1)]
    return np.max(shares, axis=0)


class StraightMotion:
    """Motion straight from corner to corner in joint space, at rest in each of them, within limits.

    corners (k, n) [rad]. Ruckig times the way along each straight line, as a single coordinate.
    """

    delay = 0.0
    """Time [s] by which limits delay its end."""

    def __init__(self, corners: np.ndarray, limits: MotionLimits) -> None:
        self.corners = corners
        self._legs = [self._time_leg(b - a, limits) for a, b in pairwise(corners)]
        self._starts = np.concatenate([[0.0], np.cumsum([leg.duration for leg in self._legs])])
        self.duration = float(self._starts[-1])
        """[s]"""

    @staticmethod
    def _time_leg(way: np.ndarray, limits: MotionLimits) -> Trajectory:
        """Time the share from 0 to 1 of a straight way (n,) [rad]."""
        request = InputParameter(1)
        request.current_position, request.target_position = [0.0], [1.0]
        most = [float((limit / np.maximum(np.abs(way), 1e-12)).min()) for limit in limits]
        request.max_velocity, request.max_acceleration, request.max_jerk = ([value] for value in most)
        trajectory = Trajectory(1)
        Ruckig(1).calculate(request, trajectory)
        return trajectory

    def state(self, time: float) -> JointState:
        """Return the joint state at a time [s] since the start; at rest before and after it."""
        time = min(max(time, 0.0), self.duration)
        k = min(int(np.searchsorted(self._starts, time, side="right")) - 1, len(self._legs) - 1)
        (share,), (speed,), (acceleration,) = self._legs[k].at_time(time - self._starts[k])
        way = self.corners[k + 1] - self.corners[k]
        return JointState(self.corners[k] + share * way, speed * way, acceleration * way)


class SmoothMotion:
    """Joint motion through samples of a path, within the joints' limits.

    times (n,) [s], q (n, joints) [rad]: the samples. Knots have the path's own speed and acceleration, so the motion
    does not stop at them. Where the limits do not allow the path's timing, the segment takes longer and the rest of the
    motion is delayed. waypoint_times: name -> time [s], and joints: names, for messages. Raises ConfigError where the
    path exceeds a limit, or the delay exceeds MAX_DELAY.
    """

    def __init__(
        self, times: np.ndarray, q: np.ndarray, limits: MotionLimits, waypoint_times: dict[str, float],
        joints: Sequence[str]
    ) -> None:
        spline = make_interp_spline(times, q, k=5)
        speed, acceleration = spline.derivative(1), spline.derivative(2)
        n = max(int(np.ceil((times[-1] - times[0]) / KNOT_SPACING)), 1)
        knots = np.linspace(times[0], times[-1], n + 1)
        states = [JointState(spline(t), speed(t), acceleration(t)) for t in knots]
        rest = np.zeros(len(joints))
        states[0], states[-1] = JointState(states[0].q, rest, rest), JointState(states[-1].q, rest, rest)
        self._limits, self._joints = limits, tuple(joints)
        self._check(knots, states, waypoint_times)
        self._segments = [self._plan_segment(a, b, float(t1 - t0)) for a, b, t0, t1 in
                          zip(states, states[1:], knots, knots[1:])]
        self._starts = np.concatenate([[0.0], np.cumsum([s.duration for s in self._segments])])
        self.duration = float(self._starts[-1])
        """[s]"""
        self.delay = self.duration - float(times[-1] - times[0])
        """Time [s] by which the limits delay the motion's end."""
        if self.delay > MAX_DELAY:
            slowest = int(np.argmax(np.diff(self._starts) - np.diff(knots)))
            raise ConfigError(f"near waypoint {_find_nearest(waypoint_times, knots[slowest])!r} the jerk limits delay "
                              f"the motion, by {self.delay:.3f} s in all; accepted: {MAX_DELAY} s; lower the speeds")

    def _check(self, knots: np.ndarray, states: list[JointState], waypoint_times: dict[str, float]) -> None:
        """Raise ConfigError where the path's own speed or acceleration exceeds a limit."""
        for quantity, values, limit, unit in (
            ("speed", np.array([s.qd for s in states]), self._limits.velocity, "rad/s"),
            ("acceleration", np.array([s.qdd for s in states]), self._limits.acceleration, "rad/s^2"),
        ):
            ratio = np.abs(values) / limit
            if ratio.max() > 1.0:
                knot, joint = np.unravel_index(np.argmax(ratio), ratio.shape)
                raise ConfigError(
                    f"near waypoint {_find_nearest(waypoint_times, knots[knot])!r} (t = {knots[knot]:.2f} s) "
                    f"joint {self._joints[joint]} would need a {quantity} of {abs(values[knot, joint]):.3f} {unit}; "
                    f"accepted: up to {limit[joint]:.3f} {unit}; lower the speeds there")

    def _plan_segment(self, a: JointState, b: JointState, duration: float) -> Trajectory:
        """Plan the motion from a to b in `duration` [s], or else as fast as possible, with as little jerk as possible.

        Ruckig uses the full jerk limit in every phase, so that a high limit causes ripples.
        """
        limits = self._limits.jerk
        jerk = np.array([self._find_least_jerk(a, b, duration, joint) for joint in range(len(limits))])
        while True:
            trajectory = self._plan(a, b, duration, jerk, range(len(limits)))
            is_at_limit = np.all(jerk >= limits)
            if trajectory is not None and (trajectory.duration <= duration + 1e-9 or is_at_limit):
                return trajectory
            if is_at_limit:
                raise ConfigError(f"no motion within the jerk limits {limits.tolist()} rad/s^3 joins two knots")
            jerk = np.minimum(1.5 * jerk, limits)

    def _find_least_jerk(self, a: JointState, b: JointState, duration: float, joint: int) -> float:
        """Find the smallest jerk limit [rad/s^3] with which one joint keeps the duration, by bisection."""
        low, high = np.log(1e-3), np.log(self._limits.jerk[joint])
        for _ in range(JERK_BISECTIONS):
            middle = 0.5 * (low + high)
            trajectory = self._plan(a, b, duration, np.full(len(self._joints), np.exp(middle)), [joint])
            if trajectory is not None and trajectory.duration <= duration + 1e-9:
                high = middle
            else:
                low = middle
        return float(np.exp(high))

    def _plan(self, a: JointState, b: JointState, duration: float, jerk: np.ndarray,
              joints: Sequence[int]) -> Trajectory | None:
        """Plan Ruckig's motion of some joints; None where it finds none."""
        n, chosen = len(joints), list(joints)
        request = InputParameter(n)
        request.current_position, request.target_position = list(a.q[chosen]), list(b.q[chosen])
        request.current_velocity, request.target_velocity = list(a.qd[chosen]), list(b.qd[chosen])
        request.current_acceleration, request.target_acceleration = list(a.qdd[chosen]), list(b.qdd[chosen])
        request.max_velocity = list(self._limits.velocity[chosen])
        request.max_acceleration = list(self._limits.acceleration[chosen])
        request.max_jerk = list(jerk[chosen])
        request.minimum_duration = duration
        trajectory = Trajectory(n)
        try:
            Ruckig(n).calculate(request, trajectory)
        except RuckigError:
            return None
        return trajectory

    def state(self, time: float) -> JointState:
        """Return the joint state at a time [s] since the start; at rest before and after it."""
        time = min(max(time, 0.0), self.duration)
        i = min(int(np.searchsorted(self._starts, time, side="right")) - 1, len(self._segments) - 1)
        return JointState(*map(np.array, self._segments[i].at_time(time - self._starts[i])))

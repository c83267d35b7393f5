"""Jerk-limited joint motion: Ruckig from state to state through knots of a joint path."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

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


def find_nearest(passages: dict[str, float], time: float) -> str:
    """Return the name of the waypoint that is passed closest to a time [s]; passages: waypoint -> time [s]."""
    return min(passages, key=lambda waypoint: abs(passages[waypoint] - time))


def compute_time_scale(times: np.ndarray, q: np.ndarray, limits: MotionLimits) -> np.ndarray:
    """Compute the factors (n,) on time that put a motion at its limits.
    At these, speed, acceleration or jerk would be at its limit. q (n, joints): joint angles [rad] at `times` (n,) [s].
    Above 1 the motion is too fast."""
    spline = make_interp_spline(times, q, k=5)
    shares = [(np.abs(spline.derivative(k)(times)) / most).max(1) ** (1.0 / k) for k, most in enumerate(limits, 1)]
    return np.max(shares, axis=0)


def plan_trajectory(a: JointState, b: JointState, limits: MotionLimits,
                    duration: float | None = None) -> Trajectory | None:
    """Plan Ruckig's motion from a state (n,) to another, in no less than `duration` [s]; None where it finds none."""
    request, trajectory = InputParameter(len(a.q)), Trajectory(len(a.q))
    request.current_position, request.current_velocity, request.current_acceleration = map(list, a)
    request.target_position, request.target_velocity, request.target_acceleration = map(list, b)
    request.max_velocity, request.max_acceleration, request.max_jerk = map(list, limits)
    request.minimum_duration = duration
    try:
        Ruckig(len(a.q)).calculate(request, trajectory)
    except RuckigError:
        return None
    return trajectory


class _Segments:
    """Ruckig's trajectories one after the other."""

    def __init__(self, segments: list[Trajectory]) -> None:
        self._segments = segments
        self._starts = np.concatenate([[0.0], np.cumsum([segment.duration for segment in segments])])
        self.duration = float(self._starts[-1])
        """[s]"""

    def _find(self, time: float) -> tuple[int, Any]:
        """Number of the segment at a time [s], and the place, speed and acceleration in it."""
        time = min(max(time, 0.0), self.duration)
        k = min(int(np.searchsorted(self._starts, time, side="right")) - 1, len(self._segments) - 1)
        return k, self._segments[k].at_time(time - self._starts[k])


class StraightMotion(_Segments):
    """Motion straight from corner to corner in joint space, at rest in each of them, within limits.
    corners (k, n) [rad]. Ruckig times the way along each straight line, as a single coordinate from 0 to 1."""

    delay = 0.0
    """Time [s] by which limits delay its end."""

    def __init__(self, corners: np.ndarray, limits: MotionLimits) -> None:
        self.corners = corners
        begin, end = (JointState(np.array([place]), np.zeros(1), np.zeros(1)) for place in (0.0, 1.0))
        segments = [plan_trajectory(begin, end, MotionLimits(*(
            np.array([(limit / np.maximum(np.abs(b - a), 1e-12)).min()]) for limit in limits)))
            for a, b in pairwise(corners)]
        super().__init__(segments)  # pyright: ignore[reportArgumentType]  (there is one between places at rest)

    def state(self, time: float) -> JointState:
        """Return the joint state at a time [s] since the start; at rest before and after it."""
        k, ((share,), (speed,), (acceleration,)) = self._find(time)
        way = self.corners[k + 1] - self.corners[k]
        return JointState(self.corners[k] + share * way, speed * way, acceleration * way)


class SmoothMotion(_Segments):
    """Joint motion through samples of a path, within the joints' limits.

    times (n,) [s], q (n, joints) [rad]: the samples. Knots have the path's own speed and acceleration, so the motion
    does not stop at them. Where the limits do not allow the path's timing, the segment takes longer and the rest of the
    motion is delayed. waypoint_times: name -> time [s], and joints: names, for messages. Raises ConfigError where the
    path exceeds a limit, or the delay exceeds MAX_DELAY."""

    def __init__(self, times: np.ndarray, q: np.ndarray, limits: MotionLimits, waypoint_times: dict[str, float],
                 joints: Sequence[str]) -> None:
        spline = make_interp_spline(times, q, k=5)
        speed, acceleration = spline.derivative(1), spline.derivative(2)
        n = max(int(np.ceil((times[-1] - times[0]) / KNOT_SPACING)), 1)
        knots = np.linspace(times[0], times[-1], n + 1)
        states = [JointState(spline(t), speed(t), acceleration(t)) for t in knots]
        rest = np.zeros(len(joints))
        states[0], states[-1] = JointState(states[0].q, rest, rest), JointState(states[-1].q, rest, rest)
        self._limits, self._joints = limits, tuple(joints)
        self._check(knots, states, waypoint_times)
        super().__init__([self._plan_segment(a, b, float(t1 - t0)) for a, b, t0, t1 in
                          zip(states, states[1:], knots, knots[1:])])
        self.delay = self.duration - float(times[-1] - times[0])
        """Time [s] by which the limits delay the motion's end."""
        if self.delay > MAX_DELAY:
            slowest = int(np.argmax(np.diff(self._starts) - np.diff(knots)))
            raise ConfigError(f"near waypoint {find_nearest(waypoint_times, knots[slowest])!r} the jerk limits delay "
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
                    f"near waypoint {find_nearest(waypoint_times, knots[knot])!r} (t = {knots[knot]:.2f} s) "
                    f"joint {self._joints[joint]} would need a {quantity} of {abs(values[knot, joint]):.3f} {unit}; "
                    f"accepted: up to {limit[joint]:.3f} {unit}; lower the speeds there")

    def _plan_segment(self, a: JointState, b: JointState, duration: float) -> Trajectory:
        """Plan the motion from a to b in `duration` [s], or else as fast as possible, with as little jerk as possible.
        Ruckig uses the full jerk limit in every phase, so that a high limit causes ripples."""
        limits = self._limits.jerk
        jerk = np.array([self._find_least_jerk(a, b, duration, joint) for joint in range(len(limits))])
        while True:
            trajectory = plan_trajectory(a, b, self._limits._replace(jerk=jerk), duration)
            is_at_limit = np.all(jerk >= limits)
            if trajectory is not None and (trajectory.duration <= duration + 1e-9 or is_at_limit):
                return trajectory
            if is_at_limit:
                raise ConfigError(f"no motion within the jerk limits {limits.tolist()} rad/s^3 joins two knots")
            jerk = np.minimum(1.5 * jerk, limits)

    def _find_least_jerk(self, a: JointState, b: JointState, duration: float, joint: int) -> float:
        """Find the smallest jerk limit [rad/s^3] with which one joint keeps the duration, by bisection."""
        own = slice(joint, joint + 1)
        begin, end = (JointState(*(values[own] for values in state)) for state in (a, b))
        limits = MotionLimits(*(values[own] for values in self._limits))
        low, high = np.log(1e-3), np.log(self._limits.jerk[joint])
        for _ in range(JERK_BISECTIONS):
            middle = 0.5 * (low + high)
            trajectory = plan_trajectory(begin, end, limits._replace(jerk=[np.exp(middle)]), duration)
            if trajectory is not None and trajectory.duration <= duration + 1e-9:
                high = middle
            else:
                low = middle
        return float(np.exp(high))

    def state(self, time: float) -> JointState:
        """Return the joint state at a time [s] since the start; at rest before and after it."""
        return JointState(*map(np.array, self._find(time)[1]))

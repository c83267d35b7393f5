"""Jerk-limited joint motion: Ruckig, state to state, through knots of the joint path."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from ruckig import InputParameter, Ruckig, RuckigError, Trajectory
from scipy.interpolate import make_interp_spline

from robosim.config.robot import LimitsConfig
from robosim.errors import ConfigError
from robosim.robot.model import SPEED_LIMITS

KNOT_SPACING = 0.04
"""[s] between knots."""
JERK_BISECTIONS = 14
"""Steps in the search for the smoothest motion between two knots: leaves 0.1 % on the jerk."""
MAX_DELAY = 0.01
"""[s] by which limits may stretch a motion before it is refused: the waypoints' times would no longer hold."""


def _nearest(waypoint_times: dict[str, float], time: float) -> str:
    """Waypoint that is passed closest to a time [s]."""
    return min(waypoint_times, key=lambda w: abs(waypoint_times[w] - time))


class JointState(NamedTuple):
    """Angles [rad], speeds [rad/s] and accelerations [rad/s^2], each (7,)."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


def excess(times: np.ndarray, q: np.ndarray, limits: LimitsConfig) -> np.ndarray:
    """How many times longer (n,) samples q (n, 7) at `times` (n,) would have to take for speed, acceleration and jerk
    to be at their limits."""
    spline = make_interp_spline(times, q, k=5)
    allowed = (SPEED_LIMITS * limits.velocity_fraction, np.array(limits.acceleration), np.array(limits.jerk))
    shares = [(np.abs(spline.derivative(k)(times)) / most).max(1) ** (1.0 / k) for k, most in enumerate(allowed, 1)]
    return np.max(shares, axis=0)


class SmoothMotion:
    """Joint motion over time through samples q (n, 7) of a path at `times` (n,), within speed, acceleration and jerk.

    Knots carry the path's own speed and acceleration, so nothing stops at them. Where the limits do not allow the
    path's timing, the segment takes longer and everything after it is later (`delay`).
    """

    def __init__(
        self, times: np.ndarray, q: np.ndarray, limits: LimitsConfig, waypoint_times: dict[str, float]
    ) -> None:
        spline = make_interp_spline(times, q, k=5)
        speed, acceleration = spline.derivative(1), spline.derivative(2)
        n = max(int(np.ceil((times[-1] - times[0]) / KNOT_SPACING)), 1)
        knots = np.linspace(times[0], times[-1], n + 1)
        states = [JointState(spline(t), speed(t), acceleration(t)) for t in knots]
        rest = np.zeros(7)
        states[0], states[-1] = JointState(states[0].q, rest, rest), JointState(states[-1].q, rest, rest)
        self._limits = limits
        self._max_velocity = SPEED_LIMITS * limits.velocity_fraction
        self._check(knots, states, waypoint_times)
        self._segments = [self._segment(a, b, float(t1 - t0)) for a, b, t0, t1 in
                          zip(states, states[1:], knots, knots[1:])]
        self._starts = np.concatenate([[0.0], np.cumsum([s.duration for s in self._segments])])
        self.duration = float(self._starts[-1])
        self.delay = self.duration - float(times[-1] - times[0])
        """[s] by which the limits stretched the motion."""
        if self.delay > MAX_DELAY:
            slowest = int(np.argmax(np.diff(self._starts) - np.diff(knots)))
            raise ConfigError(f"near waypoint {_nearest(waypoint_times, knots[slowest])!r} the jerk limits stretch the "
                              f"motion; {self.delay:.3f} s in all, allowed: {MAX_DELAY} s; lower the speeds there")

    def _check(self, knots: np.ndarray, states: list[JointState], waypoint_times: dict[str, float]) -> None:
        """Refuse a path whose own speed or acceleration breaks a limit, with the waypoint it breaks near."""
        for what, given, limit, unit in (
            ("speed", np.array([s.qd for s in states]), self._max_velocity, "rad/s"),
            ("acceleration", np.array([s.qdd for s in states]), np.array(self._limits.acceleration), "rad/s^2"),
        ):
            ratio = np.abs(given) / limit
            if ratio.max() > 1.0:
                knot, joint = np.unravel_index(np.argmax(ratio), ratio.shape)
                raise ConfigError(
                    f"near waypoint {_nearest(waypoint_times, knots[knot])!r} (t = {knots[knot]:.2f} s) "
                    f"joint A{joint + 1} would need a {what} of {abs(given[knot, joint]):.3f} {unit}; "
                    f"allowed: {limit[joint]:.3f} {unit}; lower the speeds there")

    def _segment(self, a: JointState, b: JointState, duration: float) -> Trajectory:
        """The motion from a to b in `duration` [s], or the fastest one that is slower, with as little jerk as possible.

        Ruckig plays every phase at the full jerk it is allowed, so that a generous limit means ripples.
        """
        limits = np.array(self._limits.jerk)
        jerk = np.array([self._least_jerk(a, b, duration, joint) for joint in range(7)])
        while True:
            trajectory = self._plan(a, b, duration, jerk, range(7))
            enough = np.all(jerk >= limits)
            if trajectory is not None and (trajectory.duration <= duration + 1e-9 or enough):
                return trajectory
            if enough:
                raise ConfigError(f"no motion within the jerk limits {self._limits.jerk} rad/s^3 joins two knots")
            jerk = np.minimum(1.5 * jerk, limits)

    def _least_jerk(self, a: JointState, b: JointState, duration: float, joint: int) -> float:
        """Smallest jerk limit [rad/s^3] with which one joint keeps the duration, by bisection of its logarithm."""
        low, high = np.log(1e-3), np.log(self._limits.jerk[joint])
        for _ in range(JERK_BISECTIONS):
            middle = 0.5 * (low + high)
            trajectory = self._plan(a, b, duration, np.full(7, np.exp(middle)), [joint])
            if trajectory is not None and trajectory.duration <= duration + 1e-9:
                high = middle
            else:
                low = middle
        return float(np.exp(high))

    def _plan(self, a: JointState, b: JointState, duration: float, jerk: np.ndarray,
              joints: Sequence[int]) -> Trajectory | None:
        """Ruckig's motion of some joints, None where it finds none."""
        n, chosen = len(joints), list(joints)
        request = InputParameter(n)
        request.current_position, request.target_position = list(a.q[chosen]), list(b.q[chosen])
        request.current_velocity, request.target_velocity = list(a.qd[chosen]), list(b.qd[chosen])
        request.current_acceleration, request.target_acceleration = list(a.qdd[chosen]), list(b.qdd[chosen])
        request.max_velocity = list(self._max_velocity[chosen])
        request.max_acceleration = list(np.array(self._limits.acceleration)[chosen])
        request.max_jerk = list(jerk[chosen])
        request.minimum_duration = duration
        trajectory = Trajectory(n)
        try:
            Ruckig(n).calculate(request, trajectory)
        except RuckigError:
            return None
        return trajectory

    def state(self, time: float) -> JointState:
        """Commanded joint state at a time [s] since the motion's start; at rest before and after."""
        time = min(max(time, 0.0), self.duration)
        i = min(int(np.searchsorted(self._starts, time, side="right")) - 1, len(self._segments) - 1)
        return JointState(*map(np.array, self._segments[i].at_time(time - self._starts[i])))

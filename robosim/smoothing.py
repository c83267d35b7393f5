"""Jerk-limited joint motion: Ruckig, state to state, through knots of the joint path."""

from typing import NamedTuple

import numpy as np
from ruckig import InputParameter, Ruckig, RuckigError, Trajectory
from scipy.interpolate import make_interp_spline

from robosim.arm import SPEED_LIMITS
from robosim.config import LimitsConfig
from robosim.errors import ConfigError

KNOT_SPACING = 0.04
"""[s] between knots."""
JERK_HALVINGS = 12
"""Times the jerk limit may be halved in search of the smoothest motion between two knots."""


class JointState(NamedTuple):
    """Angles [rad], speeds [rad/s] and accelerations [rad/s^2], each (7,)."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


class SmoothMotion:
    """Joint motion over time through samples q (n, 7) of a path at `times` (n,), within speed, acceleration and jerk.

    Knots carry the path's own speed and acceleration, so nothing stops at them. Where the limits do not allow the
    path's timing, the segment takes longer and everything after it is later (`delay`).
    """

    def __init__(self, times: np.ndarray, q: np.ndarray, limits: LimitsConfig, waypoint_times: dict[str, float]) -> None:
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

    def _check(self, knots: np.ndarray, states: list[JointState], waypoint_times: dict[str, float]) -> None:
        """Refuse a path whose own speed or acceleration breaks a limit, with the waypoint it breaks near."""
        for what, given, limit, unit in (
            ("speed", np.array([s.qd for s in states]), self._max_velocity, "rad/s"),
            ("acceleration", np.array([s.qdd for s in states]), np.array(self._limits.acceleration), "rad/s^2"),
        ):
            ratio = np.abs(given) / limit
            if ratio.max() > 1.0:
                knot, joint = np.unravel_index(np.argmax(ratio), ratio.shape)
                name = min(waypoint_times, key=lambda w: abs(waypoint_times[w] - knots[knot]))
                raise ConfigError(
                    f"near waypoint {name!r} (t = {knots[knot]:.2f} s) joint A{joint + 1} would need a {what} of "
                    f"{abs(given[knot, joint]):.3f} {unit}; allowed: {limit[joint]:.3f} {unit}; lower the speeds there")

    def _segment(self, a: JointState, b: JointState, duration: float) -> Trajectory:
        """The motion from a to b in `duration` [s], or the fastest one that is slower, with as little jerk as possible."""
        best = None
        for halving in range(JERK_HALVINGS):
            trajectory = self._plan(a, b, duration, np.array(self._limits.jerk) * 0.5**halving)
            if trajectory is None or (best is not None and trajectory.duration > best.duration + 1e-9):
                break
            best = trajectory
        if best is None:
            raise ConfigError(f"no motion within the jerk limits {self._limits.jerk} rad/s^3 joins two knots of the path")
        return best

    def _plan(self, a: JointState, b: JointState, duration: float, jerk: np.ndarray) -> Trajectory | None:
        request = InputParameter(7)
        request.current_position, request.target_position = list(a.q), list(b.q)
        request.current_velocity, request.target_velocity = list(a.qd), list(b.qd)
        request.current_acceleration, request.target_acceleration = list(a.qdd), list(b.qdd)
        request.max_velocity = list(self._max_velocity)
        request.max_acceleration = list(self._limits.acceleration)
        request.max_jerk = list(jerk)
        request.minimum_duration = duration
        trajectory = Trajectory(7)
        try:
            Ruckig(7).calculate(request, trajectory)
        except RuckigError:
            return None
        return trajectory

    def state(self, time: float) -> JointState:
        """Commanded joint state at a time [s] since the motion's start; at rest before and after."""
        time = min(max(time, 0.0), self.duration)
        i = min(int(np.searchsorted(self._starts, time, side="right")) - 1, len(self._segments) - 1)
        return JointState(*map(np.array, self._segments[i].at_time(time - self._starts[i])))

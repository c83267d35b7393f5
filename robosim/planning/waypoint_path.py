"""The commanded path: screws between waypoints, with blended corners so that the tool need not stop."""

from functools import cache
from typing import NamedTuple

import numpy as np

from mpm.geometry.rigid_motion import Pose, Twist, exponential, logarithm
from robosim.base.errors import ConfigError
from robosim.config.bounds import MAX_STEPS
from robosim.config.rehearsal import RehearsalConfig, WaypointConfig
from robosim.scene.models import container_shape
from robosim.shapes import tool_shape

SMOOTHSTEP_SLOPE = 1.875
"""Largest slope of the quintic smoothstep: the peak of the acceleration, in units of the mean."""
SMOOTHSTEP_CUT = 0.078125
"""Distance by which a blended corner is cut, in units of (velocity change) x (blend time)."""
MIN_BLEND = 0.02
"""Shortest blend time [s]."""
CONTAINER_MARGIN = 0.02
"""[m] around a container's inside within which the tool counts as in it."""
SCREW_SAMPLES = 400
"""Points on each commanded screw with which measured positions are compared."""
MAX_DURATION = 600.0
"""Duration [s] of a path: 60 000 poses, for each of which the joint angles are solved in a millisecond."""
AT_REST = Twist(np.zeros(3), np.zeros(3))


class Leg(NamedTuple):
    """One screw to the next waypoint."""

    twist: Twist
    """In the tool's axes [m/s], [rad/s]."""
    duration: float
    """[s]"""


class Corner(NamedTuple):
    """Passage of a waypoint."""

    time: float
    """Nominal time [s] of the passage."""
    blend: float
    """Blend time [s], half of it before the passage."""
    before: Twist | None
    """Of the leg that ends here; None: at rest."""
    after: Twist | None
    """Of the leg that begins here; None: at rest."""
    pose: Pose
    name: str

    def evaluate(self, t: float) -> Pose:
        """Return the pose at a time t [s] from the nominal passage.
        The time is within half a blend time. With S the integral of the smoothstep, the tool follows P exp(before (t -
        S)) exp(after S): it leaves the first screw and joins the second with continuous acceleration."""
        u = t / self.blend + 0.5
        S = self.blend * (u**6 - 3.0 * u**5 + 2.5 * u**4)
        pose = self.pose
        if self.before is not None:
            pose = exponential(pose, self.before, t - S)
        if self.after is not None:
            pose = exponential(pose, self.after, S)
        return pose

    def cut(self, tip: np.ndarray) -> float:
        """Return by how much [m] the tool's origin, or a point `tip` (3,) [m] of its frame, misses the waypoint."""
        before, after = self.before or AT_REST, self.after or AT_REST
        linear = np.subtract(after.linear, before.linear)
        angular = np.subtract(after.angular, before.angular)
        changes = np.linalg.norm([linear, linear + np.cross(angular, tip)], axis=1)
        return SMOOTHSTEP_CUT * self.blend * float(changes.max())


class WaypointPath:
    """Tool poses over time through all waypoints of a rehearsal, in world axes.
    Raises ConfigError where corners overlap, or are cut too much inside a container."""

    def __init__(self, config: RehearsalConfig) -> None:
        self.poses = [config.tool_pose(w) for w in config.waypoints]
        self.names = [w.name for w in config.waypoints]
        self.time_scale = 1.0
        """Factor by which the waypoints come later than the file says, rests aside."""
        self._schedule(config)

    def _schedule(self, config: RehearsalConfig) -> None:
        """Put the path into time at the configured speeds."""
        self.config = config
        """With the speeds that the path has."""
        self._legs = [make_leg(a, b, w) for a, b, w in zip(self.poses, self.poses[1:], config.waypoints[1:])]
        self._corners = self._make_corners()
        arrivals = [self._corners[0], *[c for c in self._corners if c.before is not None]]
        self.times = {corner.name: corner.time for corner in arrivals}
        """Waypoint -> time [s] of its passage."""
        self.rests = {c.name: (c.time + c.blend / 2, c.time + c.blend / 2 + w.dwell)
                      for c in arrivals[1:] for w in config.waypoints if w.name == c.name and w.stop}
        self.rests[self.names[0]] = (0.0, config.waypoints[0].dwell)
        """Waypoint -> first and last time [s] at rest there."""
        self.duration = self._corners[-1].time + self._corners[-1].blend / 2
        """[s]"""
        self._check_corners()
        slowest = max(range(len(self._legs)), key=lambda k: self._legs[k].duration)
        check_duration(self.duration, config.host_dt, f"the leg to waypoint {self.names[slowest + 1]!r} alone takes "
                       f"{self._legs[slowest].duration:.4g} s (its speed = {config.waypoints[slowest + 1].speed} m/s)")

    def slow_down(self, times: np.ndarray, factors: np.ndarray) -> None:
        """Take as many times as long as the largest of factors (n,) at `times` [s] (n,) says; rests do not."""
        factor, config = float(factors.max()), self.config
        self.time_scale *= factor
        path = config.path.model_copy(update={"acceleration": config.path.acceleration / factor**2,
                                              "angular_acceleration": config.path.angular_acceleration / factor**2})
        waypoints = tuple(waypoint.model_copy(update={
            "speed": waypoint.speed / factor, "angular_speed": waypoint.angular_speed / factor,
            "acceleration": None if waypoint.acceleration is None else waypoint.acceleration / factor**2,
        }) for waypoint in config.waypoints)
        self._schedule(config.model_copy(update={"path": path, "waypoints": waypoints}))

    def pose(self, time: float) -> Pose:
        """Return the tool's world pose at a time [s]."""
        for corner in self._corners:
            if time < corner.time - corner.blend / 2:
                # on the screw before this corner, or at rest
                return corner.pose if corner.before is None else \
                    exponential(corner.pose, corner.before, time - corner.time)
            if time <= corner.time + corner.blend / 2:
                return corner.evaluate(time - corner.time)
        return self._corners[-1].pose

    def sample_near(self, time: float, tip: np.ndarray) -> np.ndarray:
        """Sample positions (n, 6) [m] of the path about a time [s].
        Of the tool's origin and of a point `tip` (3,) [m] of its frame. They lie on the commanded screw of that time
        and on its neighbours, without blending."""
        passages = [self.times[name] for name in self.names]
        leg = int(np.clip(np.searchsorted(passages, time) - 1, 0, len(self._legs) - 1))
        legs = range(max(leg - 1, 0), min(leg + 2, len(self._legs)))
        return np.concatenate([self._sample_leg(k, tuple(tip)) for k in legs])

    @cache  # noqa: B019  (a path lives as long as its rehearsal)
    def _sample_leg(self, leg: int, tip: tuple[float, ...]) -> np.ndarray:
        """The same along one screw."""
        twist = logarithm(self.poses[leg], self.poses[leg + 1])
        poses = [exponential(self.poses[leg], twist, u) for u in np.linspace(0, 1, SCREW_SAMPLES)]
        return np.array([np.concatenate([pose.position, pose.apply(np.array(tip)[None])[0]]) for pose in poses])

    def _make_corners(self) -> list[Corner]:
        """All corners in order; a stop is one that ends at rest and, after its dwell, one that starts from it."""
        corners, time = [], 0.0
        for waypoint, pose, before, after in zip(self.config.waypoints, self.poses, [None, *self._legs],
                                                 [*self._legs, None]):
            arrival, departure = before and before.twist, after and after.twist
            if before is not None:
                time += before.duration
            if not waypoint.stop:
                corners.append(Corner(time, self._blend(waypoint, arrival, departure), arrival, departure, pose,
                                      waypoint.name))
                continue
            if arrival is not None:
                corners.append(Corner(time, self._blend(waypoint, arrival, None), arrival, None, pose, waypoint.name))
                time += corners[-1].blend / 2
            time += waypoint.dwell
            if departure is not None:
                blend = self._blend(waypoint, None, departure)
                time += blend / 2
                corners.append(Corner(time, blend, None, departure, pose,
                                      waypoint.name if arrival is None else f"{waypoint.name} (start)"))
        return corners

    def _blend(self, waypoint: WaypointConfig, before: Twist | None, after: Twist | None) -> float:
        """Time [s] of a change of twist within the acceleration limits."""
        a, b, path = before or AT_REST, after or AT_REST, self.config.path
        linear = np.linalg.norm(np.subtract(b.linear, a.linear)) / (waypoint.acceleration or path.acceleration)
        angular = np.linalg.norm(np.subtract(b.angular, a.angular)) / path.angular_acceleration
        return float(max(SMOOTHSTEP_SLOPE * max(linear, angular), MIN_BLEND))

    def _check_corners(self) -> None:
        """Corners must not overlap; inside a container the path must stay close to the screws."""
        config = self.config
        for a, b in zip(self._corners, self._corners[1:]):
            gap = b.time - a.time
            if a.after is not None and (a.blend + b.blend) / 2 > gap + 1e-9:
                own = [f"the acceleration of {w.name!r}" for w in config.waypoints if w.acceleration and
                       w.name in (a.name.removesuffix(" (start)"), b.name)]
                raise ConfigError(
                    f"waypoints {a.name!r} and {b.name!r} are {gap:.3f} s apart, but rounding their corners takes "
                    f"{(a.blend + b.blend) / 2:.3f} s: lower the speeds, raise "
                    f"{' and '.join(own) or 'path.acceleration'}, move them further apart"
                    + (f", or give {b.name!r} `stop: true`" if b.after is not None else ""))
        tip = tool_shape(config.tool).tip
        for corner in self._corners:
            is_inside = is_in_container(corner.pose.position[None], config)[0]
            if corner.before is None or corner.after is None or not is_inside:
                continue
            if corner.cut(tip) > config.path.corner_tolerance:
                raise ConfigError(
                    f"waypoint {corner.name!r} lies inside a container and its corner would be cut by "
                    f"{corner.cut(tip) * 1e3:.2f} mm; accepted: {config.path.corner_tolerance * 1e3:.2f} mm "
                    "(path.corner_tolerance): lower the speeds before and after it, or stop there")


def make_leg(a: Pose, b: Pose, waypoint: WaypointConfig) -> Leg:
    """Make the screw from a to b within a waypoint's speeds; raises ConfigError where both poses are the same."""
    unit = logarithm(a, b)
    duration = max(np.linalg.norm(unit.linear) / waypoint.speed, np.linalg.norm(unit.angular) / waypoint.angular_speed)
    if duration == 0:
        raise ConfigError(f"two waypoints share the pose at {a.position.tolist()}: leave one out, or use dwell")
    return Leg(Twist(unit.linear / duration, unit.angular / duration), float(duration))


def check_duration(duration: float, host_dt: float, reason: str) -> None:
    """Raise ConfigError for a path of a duration [s] whose points or steps of host_dt [s] are too many to be kept."""
    most = min(MAX_DURATION, MAX_STEPS * host_dt)
    if not duration <= most:
        raise ConfigError(f"the path takes {duration:.4g} s, {duration / host_dt:.3g} steps of host_dt = {host_dt} s: "
                          f"{reason}; accepted: up to {most:g} s in all")


def is_in_container(positions: np.ndarray, config: RehearsalConfig) -> np.ndarray:
    """Test which positions (n, 3) [m] of a tool's origin are in or just above a container's opening (n,)."""
    inside = np.zeros(len(positions), bool)
    for name, container in config.containers.items():
        low, high = container_shape(name, container).bounds
        p = container.pose.inverse().apply(positions)
        inside |= np.all((p < high + CONTAINER_MARGIN) & (p > low - [CONTAINER_MARGIN, CONTAINER_MARGIN, np.inf]), 1)
    return inside

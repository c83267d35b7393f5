"""The commanded path: screws between waypoints, with corners rounded in time so that the tool need not stop."""

from functools import cache
from typing import NamedTuple

import numpy as np

from mpm.geometry.rigid_motion import Pose, Twist, exponential, logarithm
from robosim.config.rehearsal import PathConfig, RehearsalConfig
from robosim.errors import ConfigError
from robosim.scene.frames import container_pose, waypoint_pose
from robosim.scene.models import read_inner_size

SMOOTHSTEP_SLOPE = 1.875
"""Largest slope of the quintic smoothstep: the peak of the acceleration, in units of the mean."""
SMOOTHSTEP_CUT = 0.078125
"""Distance by which a rounded corner is cut, in units of (velocity change) x (blend time)."""
INSIDE = 0.02
"""[m] around a container's inside within which the tool counts as in it."""
SCREW_SAMPLING = 400
"""Points on each commanded screw that reached positions are compared with."""


class Leg(NamedTuple):
    """One screw: body twist [m/s], [rad/s] from a pose, for a time [s]."""

    begin: Pose
    twist: Twist
    duration: float


class Corner(NamedTuple):
    """Passage of a waypoint: nominal time [s], blend time [s], legs before and after (None: at rest)."""

    time: float
    blend: float
    before: Leg | None
    after: Leg | None
    pose: Pose
    name: str


class CommandedPath:
    """Poses over time through all waypoints; `times` [s] maps a waypoint to the instant at which it is passed."""

    def __init__(self, config: RehearsalConfig) -> None:
        self.poses = [waypoint_pose(w, config.containers) for w in config.waypoints]
        self.names = [w.name for w in config.waypoints]
        self._legs = [_leg(a, b, w.speed, w.angular_speed)
                      for a, b, w in zip(self.poses, self.poses[1:], config.waypoints[1:])]
        self._corners = self._place_corners(config)
        arrivals = [self._corners[0], *[c for c in self._corners if c.before is not None]]
        self.times = {corner.name: corner.time for corner in arrivals}
        self.rests = {c.name: (c.time + c.blend / 2, c.time + c.blend / 2 + w.dwell)
                      for c in arrivals[1:] for w in config.waypoints if w.name == c.name and w.stop}
        self.rests[self.names[0]] = (0.0, config.waypoints[0].dwell)
        """Waypoint -> first and last instant [s] at rest there."""
        self.duration = self._corners[-1].time + self._corners[-1].blend / 2
        self._check_corners(config)

    def _place_corners(self, config: RehearsalConfig) -> list[Corner]:
        """Nominal passage times; a stop is a corner that ends at rest and, after its dwell, one that starts from it."""
        corners, time = [], 0.0
        for i, waypoint in enumerate(config.waypoints):
            before = self._legs[i - 1] if i > 0 else None
            after = self._legs[i] if i < len(self._legs) else None
            if before is not None:
                time += before.duration
            if waypoint.stop:
                if before is not None:
                    blend = _blend(before, None, config.path, waypoint.acceleration)
                    corners.append(Corner(time, blend, before, None, self.poses[i], waypoint.name))
                    time += blend / 2
                time += waypoint.dwell
                if after is not None:
                    blend = _blend(None, after, config.path, waypoint.acceleration)
                    time += blend / 2
                    corners.append(Corner(time, blend, None, after, self.poses[i],
                                          waypoint.name if before is None else f"{waypoint.name} (start)"))
            else:
                blend = _blend(before, after, config.path, waypoint.acceleration)
                corners.append(Corner(time, blend, before, after, self.poses[i], waypoint.name))
        return corners

    def _check_corners(self, config: RehearsalConfig) -> None:
        """Blends must not overlap, and inside a container they must stay close to the screws."""
        for a, b in zip(self._corners, self._corners[1:]):
            gap = b.time - a.time
            if a.after is not None and (a.blend + b.blend) / 2 > gap + 1e-9:
                raise ConfigError(
                    f"waypoints {a.name!r} and {b.name!r} are {gap:.3f} s apart, but rounding their corners takes "
                    f"{(a.blend + b.blend) / 2:.3f} s: lower the speeds, or raise path.acceleration")
        for corner in self._corners:
            if corner.before is None or corner.after is None or not self.inside(corner.pose, config):
                continue
            change = _turned(corner.after, corner.pose).linear - _turned(corner.before, corner.pose).linear
            cut = SMOOTHSTEP_CUT * corner.blend * float(np.linalg.norm(change))
            if cut > config.path.corner_tolerance:
                raise ConfigError(
                    f"waypoint {corner.name!r} lies inside a container and its corner would be cut by "
                    f"{cut * 1e3:.2f} mm; allowed: {config.path.corner_tolerance * 1e3:.2f} mm "
                    "(path.corner_tolerance): lower the speeds beside it, or stop there")

    @staticmethod
    def inside(pose: Pose, config: RehearsalConfig) -> bool:
        """Whether the tool's frame is in or just above a container's opening."""
        for name, container in config.containers.items():
            size = read_inner_size(name)
            p = container_pose(container).inverse().apply(pose.position[None])[0]
            if np.all(np.abs(p[:2]) < size[:2] / 2.0 + INSIDE) and p[2] < size[2] + INSIDE:
                return True
        return False

    def near(self, time: float, tip: np.ndarray) -> np.ndarray:
        """Places of the tool's origin and of a point of its frame (n, 6) [m] along the commanded screw of a time [s]
        and its neighbours."""
        passages = [self.times[name] for name in self.names]
        leg = int(np.clip(np.searchsorted(passages, time) - 1, 0, len(self._legs) - 1))
        legs = range(max(leg - 1, 0), min(leg + 2, len(self._legs)))
        return np.concatenate([self._points(k, tuple(tip)) for k in legs])

    @cache  # noqa: B019  (a path lives as long as its rehearsal)
    def _points(self, leg: int, tip: tuple[float, ...]) -> np.ndarray:
        """The same along one screw."""
        twist = logarithm(self.poses[leg], self.poses[leg + 1])
        poses = [exponential(self.poses[leg], twist, u) for u in np.linspace(0, 1, SCREW_SAMPLING)]
        return np.array([np.concatenate([pose.position, pose.apply(np.array(tip)[None])[0]]) for pose in poses])

    def pose(self, time: float) -> Pose:
        """Tool pose at a time [s]."""
        for corner in self._corners:
            if time < corner.time - corner.blend / 2:
                # on the straight part before this corner, or at rest
                if corner.before is None:
                    return corner.pose
                return exponential(corner.pose, corner.before.twist, time - corner.time)
            if time <= corner.time + corner.blend / 2:
                return _rounded(corner, time - corner.time)
        last = self._corners[-1]
        return last.pose


def _leg(a: Pose, b: Pose, speed: float, angular_speed: float) -> Leg:
    unit = logarithm(a, b)
    duration = max(np.linalg.norm(unit.linear) / speed, np.linalg.norm(unit.angular) / angular_speed)
    if duration == 0:
        raise ConfigError(f"two waypoints share the pose at {tuple(a.position)}: leave one out, or use dwell")
    return Leg(a, Twist(unit.linear / duration, unit.angular / duration), float(duration))


def _turned(leg: Leg, pose: Pose) -> Twist:
    """World velocity of the tool's origin when it passes `pose` on a leg."""
    R = pose.matrix
    return Twist(R @ leg.twist.linear, R @ leg.twist.angular)


def _blend(before: Leg | None, after: Leg | None, path: PathConfig, acceleration: float | None) -> float:
    """Time [s] that a change of twist takes within the acceleration limits."""
    zero = Twist(np.zeros(3), np.zeros(3))
    a, b = (before.twist if before else zero), (after.twist if after else zero)
    linear = np.linalg.norm(np.subtract(b.linear, a.linear)) / (acceleration or path.acceleration)
    angular = np.linalg.norm(np.subtract(b.angular, a.angular)) / path.angular_acceleration
    return float(max(SMOOTHSTEP_SLOPE * max(linear, angular), 0.02))


def _rounded(corner: Corner, t: float) -> Pose:
    """Pose at time t [s] from a corner's nominal passage: the twist fades from one leg to the other.

    With S the integral of the smoothstep, the tool follows P exp(before (t - S)) exp(after S): it leaves the first
    screw and joins the second with continuous acceleration.
    """
    u = t / corner.blend + 0.5
    S = corner.blend * (u**6 - 3.0 * u**5 + 2.5 * u**4)
    pose = corner.pose
    if corner.before is not None:
        pose = exponential(pose, corner.before.twist, t - S)
    if corner.after is not None:
        pose = exponential(pose, corner.after.twist, S)
    return pose

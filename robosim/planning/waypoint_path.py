"""The commanded path: screws between waypoints, with blended corners so that the tool need not stop."""

from functools import cache

import numpy as np

from mpm.geometry.rigid_motion import Pose, exponential, logarithm
from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.pose_sequences import check_duration
from robosim.planning.screw_legs import Corner, compute_blend_time, compute_corner_cut, make_leg
from robosim.scene.frames import container_pose, waypoint_pose
from robosim.scene.models import container_shape
from robosim.shapes import tool_shape

CONTAINER_MARGIN = 0.02
"""[m] around a container's inside within which the tool counts as in it."""
SCREW_SAMPLES = 400
"""Points on each commanded screw with which measured positions are compared."""


class WaypointPath:
    """Tool poses over time through all waypoints of a rehearsal, in world axes.

    Raises ConfigError where corners overlap, or are cut too much inside a container.
    """

    def __init__(self, config: RehearsalConfig) -> None:
        self.poses = [waypoint_pose(w, config.containers) for w in config.waypoints]
        self.names = [w.name for w in config.waypoints]
        self._legs = [make_leg(a, b, w.speed, w.angular_speed)
                      for a, b, w in zip(self.poses, self.poses[1:], config.waypoints[1:])]
        self._corners = self._schedule_corners(config)
        arrivals = [self._corners[0], *[c for c in self._corners if c.before is not None]]
        self.times = {corner.name: corner.time for corner in arrivals}
        """Waypoint -> time [s] of its passage."""
        self.rests = {c.name: (c.time + c.blend / 2, c.time + c.blend / 2 + w.dwell)
                      for c in arrivals[1:] for w in config.waypoints if w.name == c.name and w.stop}
        self.rests[self.names[0]] = (0.0, config.waypoints[0].dwell)
        """Waypoint -> first and last time [s] at rest there."""
        self.duration = self._corners[-1].time + self._corners[-1].blend / 2
        """[s]"""
        self._check_overlaps()
        self._check_cuts(config)
        slowest = max(range(len(self._legs)), key=lambda k: self._legs[k].duration)
        check_duration(self.duration, config.host_dt, f"the leg to waypoint {self.names[slowest + 1]!r} alone takes "
                       f"{self._legs[slowest].duration:.4g} s (its speed = {config.waypoints[slowest + 1].speed} m/s)")

    def pose(self, time: float) -> Pose:
        """Return the tool's world pose at a time [s]."""
        for corner in self._corners:
            if time < corner.time - corner.blend / 2:
                # on the screw before this corner, or at rest
                if corner.before is None:
                    return corner.pose
                return exponential(corner.pose, corner.before.twist, time - corner.time)
            if time <= corner.time + corner.blend / 2:
                return corner.evaluate(time - corner.time)
        last = self._corners[-1]
        return last.pose

    def sample_near(self, time: float, tip: np.ndarray) -> np.ndarray:
        """Sample positions (n, 6) [m] of the path about a time [s].

        Of the tool's origin and of a point `tip` (3,) [m] of its frame. They lie on the commanded screw of that time
        and on its neighbours, without blending.
        """
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

    def _schedule_corners(self, config: RehearsalConfig) -> list[Corner]:
        """All corners in order; a stop is one that ends at rest and, after its dwell, one that starts from it."""
        corners, time = [], 0.0
        for i, waypoint in enumerate(config.waypoints):
            before = self._legs[i - 1] if i > 0 else None
            after = self._legs[i] if i < len(self._legs) else None
            if before is not None:
                time += before.duration
            if waypoint.stop:
                if before is not None:
                    blend = compute_blend_time(before, None, config.path, waypoint.acceleration)
                    corners.append(Corner(time, blend, before, None, self.poses[i], waypoint.name))
                    time += blend / 2
                time += waypoint.dwell
                if after is not None:
                    blend = compute_blend_time(None, after, config.path, waypoint.acceleration)
                    time += blend / 2
                    corners.append(Corner(time, blend, None, after, self.poses[i],
                                          waypoint.name if before is None else f"{waypoint.name} (start)"))
            else:
                blend = compute_blend_time(before, after, config.path, waypoint.acceleration)
                corners.append(Corner(time, blend, before, after, self.poses[i], waypoint.name))
        return corners

    def _check_overlaps(self) -> None:
        for a, b in zip(self._corners, self._corners[1:]):
            gap = b.time - a.time
            if a.after is not None and (a.blend + b.blend) / 2 > gap + 1e-9:
                raise ConfigError(
                    f"waypoints {a.name!r} and {b.name!r} are {gap:.3f} s apart, but rounding their corners takes "
                    f"{(a.blend + b.blend) / 2:.3f} s: lower the speeds, or raise path.acceleration")

    def _check_cuts(self, config: RehearsalConfig) -> None:
        """Inside a container the path must stay close to the screws."""
        for corner in self._corners:
            if corner.before is None or corner.after is None or not is_in_container(corner.pose, config):
                continue
            cut = compute_corner_cut(corner, tool_shape(config.tool).tip)
            if cut > config.path.corner_tolerance:
                raise ConfigError(
                    f"waypoint {corner.name!r} lies inside a container and its corner would be cut by "
                    f"{cut * 1e3:.2f} mm; accepted: {config.path.corner_tolerance * 1e3:.2f} mm "
                    "(path.corner_tolerance): lower the speeds before and after it, or stop there")


def is_in_container(pose: Pose, config: RehearsalConfig) -> bool:
    """Test whether a tool's origin is in or just above a container's opening.

    pose: of the tool in the world.
    """
    for name, container in config.containers.items():
        low, high = container_shape(name, container).bounds
        p = container_pose(container).inverse().apply(pose.position[None])[0]
        if np.all((p < high + CONTAINER_MARGIN) & (p > low - [CONTAINER_MARGIN, CONTAINER_MARGIN, np.inf])):
            return True
    return False

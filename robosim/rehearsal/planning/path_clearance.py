"""Clearances along a planned path: a collision is refused before anything is simulated."""

from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.planning.learned_path import LearnedPath
from robosim.rehearsal.planning.robot_clearance import FAR, Nearest, RobotClearance
from robosim.rehearsal.planning.waypoint_path import WaypointPath
from robosim.scene.container_clearance import monitor_containers

STRIDE = 4
"""Samples of the path from one measured posture to the next: at 0.04 s a tool at 0.3 m/s moves by 12 mm."""
LEAST = 5e-4
"""Smallest distance [m] of a planned motion from obstacles: a blade is led a millimetre above the table."""


class PathClearance(NamedTuple):
    """The smallest distances along a path."""

    surroundings: Nearest
    """Of arm, hand and tool from table, floor, obstacles; of arm and hand from containers."""
    itself: Nearest
    """Between parts of the arm, and of hand and tool from the arm."""


def check_path(config: RehearsalConfig, path: WaypointPath | LearnedPath, times: np.ndarray, q: np.ndarray,
               robot: RobotClearance) -> PathClearance:
    """Measure the clearances of postures q (n, joints) [rad] at times (n,) [s].

    Raises ConfigError for a collision: at which waypoint, of what with what, how deep.
    """
    surface = monitor_containers(config)
    least = PathClearance(FAR, FAR)
    for time, posture in zip(times[::STRIDE], q[::STRIDE]):
        found = robot.measure(posture)
        least = PathClearance(*(min(a, b, key=lambda nearest: nearest.distance) for a, b in zip(least, found)))
        for nearest in found:
            if nearest.distance < LEAST:
                raise ConfigError(_describe(path, time, nearest.parts, nearest.distance))
        if surface is not None:
            surface.record_penetrations(path.pose(time))
            if surface.penetrations:
                raise ConfigError(_describe(path, time, (config.tool_name, "a container"), -surface.depth))
    return least


def _describe(path: WaypointPath | LearnedPath, time: float, parts: tuple[str, str], distance: float) -> str:
    """Describe a collision; the waypoint is the one that is passed closest to its time [s]."""
    name = min(path.times, key=lambda waypoint: abs(path.times[waypoint] - time))
    what = f"overlap by {-1e3 * distance:.1f} mm" if distance < 0.0 else f"are {1e3 * distance:.1f} mm apart"
    return (f"near waypoint {name!r} (t = {time:.2f} s) {parts[0]} and {parts[1]} {what}; accepted: {1e3 * LEAST:g} mm "
            f"or more; move the waypoint, or what stands there")

"""Clearances along a planned path, and in the tilts of a dose: a collision is refused before anything is simulated."""

from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.learned_path import LearnedPath
from robosim.planning.lip_motion import make_lip_motion
from robosim.planning.robot_clearance import FAR, Nearest, RobotClearance
from robosim.planning.waypoint_path import WaypointPath
from robosim.robot.inverse_kinematics import solve_pose
from robosim.robot.model import Arm
from robosim.scene.container_clearance import monitor_containers

STRIDE = 4
"""Samples of the path from one measured posture to the next: at 0.04 s a tool at 0.3 m/s moves by 12 mm."""
TILT_STEP = np.radians(2.0)
"""Tilt [rad] from one checked pose of a dose to the next."""
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


def check_dose_reach(config: RehearsalConfig, arm: Arm, q: np.ndarray, robot: RobotClearance) -> None:
    """Check the whole range of tilt, with the lip where the dose begins and above the cup's middle.

    q: posture at the waypoint (n,) [rad]. Raises UnreachableWaypoint for a tilt that the arm cannot reach from there,
    ConfigError for one at which it would touch something: at which tilt, and what.
    """
    if config.dose is None:
        return
    motion = make_lip_motion(config)
    largest = np.radians(config.dose.largest_tilt_deg)
    surface = monitor_containers(config)
    for lip in (motion.lip, motion.goal):
        posture = q
        for tilt in np.linspace(0.0, largest, int(np.ceil(largest / TILT_STEP)) + 1):
            place, where = motion.pose(tilt, lip), f"{config.dose_at} (dose, tilt {np.degrees(tilt):.0f} deg)"
            solution = solve_pose(arm, place, posture, rest=q)
            if not solution.converged:
                raise UnreachableWaypoint(where, solution.position_error, np.degrees(solution.angle_error),
                                          arm.distance_beyond_reach(place.position))
            posture, nearest = solution.q, robot.least(solution.q)
            if nearest.distance < LEAST:
                raise ConfigError(f"near waypoint {where} {nearest.parts[0]} and {nearest.parts[1]} are "
                                  f"{1e3 * nearest.distance:.1f} mm apart; accepted: {1e3 * LEAST:g} mm or more; a "
                                  f"smaller dose.largest_tilt_deg, or more room there")
            if surface is not None:
                surface.record_penetrations(place)
                if surface.penetrations:
                    raise ConfigError(f"near waypoint {where} the {config.tool_name} and a container overlap by "
                                      f"{1e3 * surface.depth:.1f} mm; accepted: the lip above the cup's rim, or a "
                                      f"smaller dose.largest_tilt_deg")


def _describe(path: WaypointPath | LearnedPath, time: float, parts: tuple[str, str], distance: float) -> str:
    """Describe a collision; the waypoint is the one that is passed closest to its time [s]."""
    name = min(path.times, key=lambda waypoint: abs(path.times[waypoint] - time))
    what = f"overlap by {-1e3 * distance:.1f} mm" if distance < 0.0 else f"are {1e3 * distance:.1f} mm apart"
    return (f"near waypoint {name!r} (t = {time:.2f} s) {parts[0]} and {parts[1]} {what}; accepted: {1e3 * LEAST:g} mm "
            f"or more; move the waypoint, or what stands there")

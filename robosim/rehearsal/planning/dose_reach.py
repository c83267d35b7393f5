"""Whether an arm can tilt its tool about the lip as far as a dose may ask for, before anything is simulated."""

import numpy as np

from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.dosing.lip_motion import make_lip_motion
from robosim.rehearsal.planning.path_clearance import LEAST
from robosim.rehearsal.planning.robot_clearance import RobotClearance
from robosim.robot.inverse_kinematics import solve_pose
from robosim.robot.model import Arm
from robosim.scene.container_clearance import monitor_containers

STEP = np.radians(2.0)
"""Tilt [rad] from one checked pose to the next."""


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
        for tilt in np.linspace(0.0, largest, int(np.ceil(largest / STEP)) + 1):
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

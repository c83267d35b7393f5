"""Picking a tool that stands somewhere: the open hand approaches, closes, lifts by friction, and may set it down."""

import numpy as np
from scipy.spatial.transform import Rotation

from robosim.config.rehearsal import APPROACH, RETREAT, RehearsalConfig, WaypointConfig
from robosim.robot.assembly import Assembly
from robosim.robot.mjspec import find_site_pose

SETTLING = 0.2
"""Time [s] at rest after the fingers have closed, and before they open."""


def add_picking(config: RehearsalConfig, assembly: Assembly) -> RehearsalConfig:
    """Return a configuration whose hand comes from a distance to the first waypoint, and rests there while it closes.
    The tool of the approach's waypoint is where it would be in the hand: it stands at the first waypoint all the while.
    Where it is set down, the hand rests at the last waypoint while it opens, and goes back. Unchanged where nothing is
    picked."""
    if config.pick is None or assembly.tool is None:
        return config
    first, last = config.waypoints[0], config.waypoints[-1]
    dwell = config.grasp_time + SETTLING
    standing = first.model_copy(update={"stop": True, "dwell": max(first.dwell, dwell)})
    waypoints = [stand_off(config, assembly, first, APPROACH), standing, *config.waypoints[1:]]
    if config.pick.set_down:
        waypoints[-1] = last.model_copy(update={"stop": True, "dwell": max(last.dwell, SETTLING + dwell)})
        waypoints.append(stand_off(config, assembly, last, RETREAT))
    return config.model_copy(update={"waypoints": tuple(waypoints)})


def stand_off(config: RehearsalConfig, assembly: Assembly, waypoint: WaypointConfig, name: str) -> WaypointConfig:
    """Return a waypoint with the hand away from another one, against its approach direction."""
    assert config.pick is not None and assembly.tool is not None
    stand = config.tool_pose(waypoint)
    grip = find_site_pose(assembly.tool.spec, assembly.tool.grip, assembly.tool.name)
    turned = Rotation.from_matrix(grip.matrix) * Rotation.from_euler("z", -assembly.grip_turn_deg, degrees=True)
    back = stand.matrix @ turned.as_matrix() @ [0.0, -config.pick.approach, 0.0]
    euler = Rotation.from_matrix(stand.matrix).as_euler("xyz", degrees=True)
    return WaypointConfig(name=name, frame="world", position=tuple((stand.position + back).tolist()),
                          rotation_deg=tuple(np.clip(euler, -360.0, 360.0).tolist()), speed=config.waypoints[0].speed,
                          stop=True)

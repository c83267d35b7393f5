"""Picking a tool that stands somewhere: the open hand approaches, closes, and lifts by friction."""

import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.config.motion import APPROACH, WaypointConfig
from robosim.config.rehearsal import RehearsalConfig
from robosim.robot.assembly import Assembly
from robosim.robot.mjspec import find_site_pose
from robosim.scene.frames import waypoint_pose

SETTLING = 0.2
"""Time [s] at rest after the fingers have closed."""


def add_approach(config: RehearsalConfig, assembly: Assembly) -> RehearsalConfig:
    """Return a configuration whose hand comes from a distance to the first waypoint, and rests there while it closes.

    The tool of the approach's waypoint is where it would be in the hand: it stands at the first waypoint all the while.
    Unchanged where nothing is picked.
    """
    if config.pick is None or assembly.tool is None:
        return config
    first = config.waypoints[0]
    stand = waypoint_pose(first, config.containers)
    grip = find_site_pose(assembly.tool.spec, assembly.tool.grip, assembly.tool.name)
    turned = Rotation.from_matrix(grip.matrix) * Rotation.from_euler("z", -assembly.grip_turn_deg, degrees=True)
    back = stand.matrix @ turned.as_matrix() @ [0.0, -config.pick.approach, 0.0]
    euler = Rotation.from_matrix(stand.matrix).as_euler("xyz", degrees=True)
    pose = Pose(stand.position + back, stand.quaternion)
    approach = WaypointConfig(name=APPROACH, frame="world", position=tuple(pose.position.tolist()),
                              rotation_deg=tuple(np.clip(euler, -360.0, 360.0).tolist()), speed=first.speed, stop=True)
    dwell = max(first.dwell, config.grasp_time + SETTLING)
    standing = first.model_copy(update={"stop": True, "dwell": dwell})
    return config.model_copy(update={"waypoints": (approach, standing, *config.waypoints[1:])})

"""Frames read from MuJoCo, and frames named in configurations."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.config.rehearsal import WaypointConfig
from robosim.config.scene import ContainerConfig


def body_pose(data: mujoco.MjData, body: int) -> Pose:
    """World pose of a body's frame."""
    return Pose(data.xpos[body].copy(), data.xquat[body].copy())


def container_pose(container: ContainerConfig) -> Pose:
    """World pose of a container: origin in the middle of its inner floor."""
    turn = Rotation.from_euler("z", container.yaw_deg, degrees=True)
    return Pose(np.asarray(container.position), turn.as_quat(scalar_first=True))


def waypoint_pose(waypoint: WaypointConfig, containers: dict[str, ContainerConfig]) -> Pose:
    """World pose of the tool's frame at a waypoint."""
    turn = Rotation.from_euler("xyz", waypoint.rotation_deg, degrees=True)
    local = Pose(np.asarray(waypoint.position), turn.as_quat(scalar_first=True))
    if waypoint.frame == "world":
        return local
    return container_pose(containers[waypoint.frame]) @ local

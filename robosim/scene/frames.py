"""World poses of MuJoCo bodies, containers and waypoints."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.config.motion import WaypointConfig
from robosim.config.scene import ContainerConfig


def body_pose(data: mujoco.MjData, body: int) -> Pose:
    """Return the world pose of a body's frame."""
    return Pose(data.xpos[body].copy(), data.xquat[body].copy())


def container_pose(container: ContainerConfig) -> Pose:
    """Return the world pose of a container's frame.

    Its origin is the centre of the inner floor, or that of its mesh.
    """
    rotation = Rotation.from_euler("z", container.yaw_deg, degrees=True)
    if any(container.tilt_deg):
        rotation = rotation * Rotation.from_euler("xy", container.tilt_deg, degrees=True)
    return Pose(np.asarray(container.position), rotation.as_quat(scalar_first=True))


def waypoint_pose(waypoint: WaypointConfig, containers: dict[str, ContainerConfig]) -> Pose:
    """Return the world pose of the tool's frame at a waypoint."""
    rotation = Rotation.from_euler("xyz", waypoint.rotation_deg, degrees=True)
    local = Pose(np.asarray(waypoint.position), rotation.as_quat(scalar_first=True))
    if waypoint.frame == "world":
        return local
    return container_pose(containers[waypoint.frame]) @ local

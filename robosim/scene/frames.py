"""World poses of MuJoCo's bodies."""

import mujoco

from mpm import Pose


def body_pose(data: mujoco.MjData, body: int) -> Pose:
    """Return the world pose of a body's frame."""
    return Pose(data.xpos[body].copy(), data.xquat[body].copy())

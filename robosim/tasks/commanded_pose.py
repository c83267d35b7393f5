"""The tool's commanded pose, moved by the velocities of actions."""

import numpy as np

import mpm
from mpm.geometry.rigid_motion import rotate
from robosim.tasks.task import TaskConfig


def move_pose(pose: mpm.Pose, task: TaskConfig, linear: np.ndarray, angular: np.ndarray) -> mpm.Pose:
    """Move a pose by one step of velocities [m/s], [rad/s] in world axes; the origin stays in the task's box."""
    position = np.clip(pose.position + task.step_dt * linear, task.action.lower, task.action.upper)
    return mpm.Pose(position, rotate(pose.quaternion, task.step_dt * angular))

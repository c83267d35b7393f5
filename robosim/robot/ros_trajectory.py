"""A planned motion in the layout of ROS 2's trajectory_msgs/JointTrajectory."""

import numpy as np

from robosim.robot.timing import SmoothMotion
from robosim.scene.models import ARM_JOINTS

POINT_INTERVAL = 0.01
"""Longest time [s] between points: a quarter of the motion's knots, so that quintics between points reproduce it."""


def make_joint_trajectory(motion: SmoothMotion) -> dict:
    """Make the message's fields as plain Python values.

    Points hold positions [rad], velocities [rad/s], accelerations [rad/s^2] and the time from the start.
    """
    points = []
    for time in np.linspace(0.0, motion.duration, int(np.ceil(motion.duration / POINT_INTERVAL)) + 1):
        state = motion.state(time)
        nanoseconds = round(time * 1e9)
        points.append({"positions": _round(state.q), "velocities": _round(state.qd), "accelerations": _round(state.qdd),
                       "time_from_start": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}})
    return {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "joint_names": list(ARM_JOINTS),
            "points": points}


def _round(values: np.ndarray) -> list[float]:
    """Round to 1e-9: encoders resolve 1e-6 rad at best."""
    return [round(float(value), 9) for value in values]

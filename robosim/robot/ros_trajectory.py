"""A planned motion for a real arm: joint_trajectory.yaml, in the layout of ROS 2's trajectory_msgs/JointTrajectory."""

import numpy as np

from robosim.robot.timing import SmoothMotion
from robosim.scene.robot_spec import ARM_JOINTS

EVERY = 0.01
"""[s] between points: a controller that joins them by quintics stays on the motion, whose knots are 0.04 s apart."""


def joint_trajectory(motion: SmoothMotion) -> dict:
    """Names, and points with positions [rad], velocities [rad/s], accelerations [rad/s^2] and time from the start."""
    points = []
    for time in np.linspace(0.0, motion.duration, int(np.ceil(motion.duration / EVERY)) + 1):
        state = motion.state(time)
        nanoseconds = round(time * 1e9)
        points.append({"positions": rounded(state.q), "velocities": rounded(state.qd),
                       "accelerations": rounded(state.qdd),
                       "time_from_start": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}})
    return {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "joint_names": list(ARM_JOINTS),
            "points": points}


def rounded(values: np.ndarray) -> list[float]:
    """As many digits as mean anything: an encoder tells 1e-6 rad at best."""
    return [round(float(value), 9) for value in values]

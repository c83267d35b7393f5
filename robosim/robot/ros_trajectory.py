"""A planned motion in the layout of ROS 2's trajectory_msgs/JointTrajectory."""

from collections.abc import Sequence

import numpy as np

from robosim.base.errors import ConfigError, UnknownName
from robosim.config.motion import JointTrajectoryConfig
from robosim.robot.hand import Hand
from robosim.robot.timing import JointMotion

POINT_INTERVAL = 0.01
"""Longest time [s] between points of a motion: a quarter of its knots, so that quintics between points reproduce it."""


def make_joint_trajectory(motion: JointMotion, joints: Sequence[str], names: JointTrajectoryConfig | None = None, *,
                          start: float = 0.0) -> dict:
    """Make the message's fields as plain Python values.

    Points hold positions [rad], velocities [rad/s], accelerations [rad/s^2] and the time from the start. start [s]: at
    which the motion begins; before it the arm rests at the motion's first point. joints: the model's names of them.
    names: of frame and joints; None: no frame, and the model's. Raises ConfigError, UnknownName for joint names that
    cannot be used."""
    names = names or JointTrajectoryConfig()
    joint_names = name_joints(joints, names)
    times = start + np.linspace(0.0, motion.duration, int(np.ceil(motion.duration / POINT_INTERVAL)) + 1)
    points = []
    for time in ([0.0] if start > 0.0 else []) + times.tolist():
        state = motion.state(time - start)
        points.append({"positions": _round(state.q), "velocities": _round(state.qd), "accelerations": _round(state.qdd),
                       "time_from_start": _split(time)})
    return {"header": {"stamp": _split(0.0), "frame_id": names.frame_id}, "joint_names": joint_names, "points": points}


def make_gripper_commands(hand: Hand, changes: Sequence[tuple[float, bool]]) -> dict:
    """Make the commands of a hand that is open or closed at times [s], as plain Python values.
    changes: (time, whether it is closed then); between two it moves. Values are those of the model's actuators; times
    count from the start, as those of the trajectory do."""
    return {"actuator_names": list(hand.open),
            "points": [{"positions": list((hand.closed if is_closed else hand.open).values()),
                        "time_from_start": _split(time)} for time, is_closed in changes]}


def name_joints(joints: Sequence[str], names: JointTrajectoryConfig) -> list[str]:
    """Name an arm's joints, from the base on, for a controller; raises UnknownName, ConfigError for one name of two."""
    for joint in names.joint_names:
        if joint not in joints:
            raise UnknownName("joint_trajectory.joint_names: joint", joint, joints)
    chosen = [names.joint_names.get(joint, names.joint_prefix + joint) for joint in joints]
    if len(set(chosen)) < len(chosen) or "" in chosen:
        raise ConfigError(f"joint_trajectory.joint_names gives {', '.join(map(repr, chosen))}; accepted: a different "
                          f"name for each joint")
    return chosen


def _split(time: float) -> dict[str, int]:
    """Return a time [s] as ROS has it."""
    nanoseconds = round(time * 1e9)
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def _round(values: np.ndarray) -> list[float]:
    """Round to 1e-9: encoders resolve 1e-6 rad at best."""
    return [round(float(value), 9) for value in values]

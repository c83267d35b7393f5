"""Messages of ROS 2 from the readings of a run."""

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
"""Definitions of messages; those used here are the same in all later distributions."""
MSG: Any = STORE.types
FLOAT32 = 7
"""PointField.FLOAT32."""


def stamp(time: float) -> Any:
    """Return a time [s] of the simulation as builtin_interfaces/Time."""
    nanoseconds = round(time * 1e9)
    return MSG["builtin_interfaces/msg/Time"](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def header(time: float, frame: str) -> Any:
    """Return std_msgs/Header."""
    return MSG["std_msgs/msg/Header"](stamp=stamp(time), frame_id=frame)


def joint_state(time: float, names: list[str], q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> Any:
    """Return sensor_msgs/JointState of angles [rad], speeds [rad/s] and torques [N m] (n,)."""
    return MSG["sensor_msgs/msg/JointState"](header=header(time, ""), name=names, position=np.asarray(q, float),
                                             velocity=np.asarray(qd, float), effort=np.asarray(torque, float))


def wrench(time: float, frame: str, values: np.ndarray) -> Any:
    """Return geometry_msgs/WrenchStamped of force [N] and torque [N m] (6,)."""
    vector = MSG["geometry_msgs/msg/Vector3"]
    force, torque = (vector(x=float(v[0]), y=float(v[1]), z=float(v[2])) for v in (values[:3], values[3:]))
    return MSG["geometry_msgs/msg/WrenchStamped"](
        header=header(time, frame), wrench=MSG["geometry_msgs/msg/Wrench"](force=force, torque=torque))


def image(time: float, frame: str, pixels: np.ndarray) -> Any:
    """Return sensor_msgs/Image of pixels (height, width, 3), RGB."""
    height, width, _ = pixels.shape
    return MSG["sensor_msgs/msg/Image"](header=header(time, frame), height=height, width=width, encoding="rgb8",
                                        is_bigendian=0, step=3 * width,
                                        data=np.ascontiguousarray(pixels, np.uint8).ravel())


def point_cloud(time: float, frame: str, points: np.ndarray, names: list[str]) -> Any:
    """Return sensor_msgs/PointCloud2 of points (n, k) with these fields in single precision."""
    field = MSG["sensor_msgs/msg/PointField"]
    fields = [field(name=name, offset=4 * k, datatype=FLOAT32, count=1) for k, name in enumerate(names)]
    step, n = 4 * len(names), len(points)
    data = np.ascontiguousarray(points, "<f4").view(np.uint8).ravel()
    return MSG["sensor_msgs/msg/PointCloud2"](header=header(time, frame), height=1, width=n, fields=fields,
                                              is_bigendian=False, point_step=step, row_step=step * n, data=data,
                                              is_dense=True)


def transforms(time: float, parent: str, poses: dict[str, np.ndarray]) -> Any:
    """Return tf2_msgs/TFMessage of frames: name -> position [m], quaternion (w, x, y, z) (7,)."""
    vector, quaternion = MSG["geometry_msgs/msg/Vector3"], MSG["geometry_msgs/msg/Quaternion"]
    parts = []
    for name, pose in poses.items():
        x, y, z, qw, qx, qy, qz = map(float, pose)
        parts.append(MSG["geometry_msgs/msg/TransformStamped"](
            header=header(time, parent), child_frame_id=name, transform=MSG["geometry_msgs/msg/Transform"](
                translation=vector(x=x, y=y, z=z), rotation=quaternion(x=qx, y=qy, z=qz, w=qw))))
    return MSG["tf2_msgs/msg/TFMessage"](transforms=parts)


def joint_trajectory(table: dict[str, Any]) -> Any:
    """Return trajectory_msgs/JointTrajectory of a file joint_trajectory.yaml."""
    point, duration = MSG["trajectory_msgs/msg/JointTrajectoryPoint"], MSG["builtin_interfaces/msg/Duration"]
    points = [point(positions=np.array(p["positions"], float), velocities=np.array(p["velocities"], float),
                    accelerations=np.array(p["accelerations"], float), effort=np.zeros(0),
                    time_from_start=duration(**p["time_from_start"])) for p in table["points"]]
    return MSG["trajectory_msgs/msg/JointTrajectory"](header=header(0.0, table["header"]["frame_id"]),
                                                      joint_names=list(table["joint_names"]), points=points)

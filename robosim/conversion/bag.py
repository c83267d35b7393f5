"""A run as a bag of ROS 2: messages of joints, wrenches, poses, grains, pictures and the planned motion."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mpm.files import temporary_path
from robosim.base.errors import ConfigError
from robosim.base.input_files import read_rows, read_text, to_numbers
from robosim.base.progress import Progress
from robosim.config.settings import parse_yaml
from robosim.conversion.joint_log_files import AXES, MOST_BYTES
from robosim.recordings.reader import Recording, find_recordings

STORE = get_typestore(Stores.ROS2_HUMBLE)
"""Definitions of messages; those used here are the same in all later distributions."""
MSG: Any = STORE.types
FLOAT32 = 7
"""PointField.FLOAT32."""
WORLD = "world"
"""Frame of all poses and grains."""
IMAGE_WIDTH = 640
"""Of pictures [pixels]: larger ones fill a disk without a codec."""
PLUGINS = {"mcap": StoragePlugin.MCAP, "rosbag2": StoragePlugin.SQLITE3}


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


class Message(NamedTuple):
    """A message with its topic and time [s]."""

    topic: str
    time: float
    content: Any


def write_bag(run: Path, out: Path, plugin: str) -> dict[str, int]:
    """Write the bag of a run's folder as the folder `out`; return the number of messages of each topic.
    Raises ConfigError for a folder that is no run's, or an `out` that exists."""
    if out.exists():
        raise ConfigError(f"--out {out}: exists; accepted: a new folder")
    path = find_recordings(run)[0]
    counts: dict[str, int] = {}
    unfinished = temporary_path(out)
    try:
        with Recording(path) as recording, Writer(unfinished, version=9, storage_plugin=PLUGINS[plugin]) as writer:
            connections: dict[str, Any] = {}
            for message in Progress(collect(run, recording), desc="messages"):
                kind = message.content.__msgtype__
                if message.topic not in connections:
                    connections[message.topic] = writer.add_connection(message.topic, kind, typestore=STORE)
                counts[message.topic] = counts.get(message.topic, 0) + 1
                writer.write(connections[message.topic], round(message.time * 1e9),
                             STORE.serialize_cdr(message.content, kind))
        unfinished.replace(out)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    return counts


def collect(run: Path, recording: Recording) -> Iterator[Message]:
    """Yield the messages of a run, topic after topic."""
    trajectory, planned = run / "trajectory.csv", run / "joint_trajectory.yaml"
    if planned.is_file():
        table: Any = parse_yaml(read_text(planned, 200_000_000))
        yield Message("/joint_trajectory", 0.0, joint_trajectory(table))
    if trajectory.is_file():
        yield from _joints(trajectory)
    moving = [body.name for body in recording.header.moving]
    tool = recording.header.tool
    for k in range(len(recording)):
        scene, grains = recording.scene(k), recording.grains(k)
        yield Message("/tf", scene.time, transforms(scene.time, WORLD, dict(zip(moving, scene.poses))))
        if tool:
            yield Message("/grains/wrench", scene.time, wrench(scene.time, WORLD, scene.wrench))
        if recording.header.grains:
            points = np.column_stack([grains.positions, grains.speeds, grains.pressures])
            yield Message("/grains/points", scene.time, point_cloud(scene.time, WORLD, points, [
                "x", "y", "z", "speed", "pressure"]))
    film = run / "rehearsal.mp4"
    if film.is_file():
        yield from _pictures(film)


def _joints(path: Path) -> Iterator[Message]:
    rows = read_rows(path, MOST_BYTES, path)
    names = [name.removeprefix("q_").removesuffix("_rad") for name in rows[0] if name.startswith("q_")]
    columns = [form.format(name) for form in ("q_{}_rad", "qd_{}_rad_s", "sensed_torque_{}_Nm") for name in names]
    n = len(names)
    for time, *values in to_numbers(rows, ["time_s", *columns, *(f"wrist_{axis}" for axis in AXES)], path).tolist():
        q, qd, torque, wrist = np.split(values, [n, 2 * n, 3 * n])
        yield Message("/joint_states", time, joint_state(time, names, q, qd, torque))
        yield Message("/wrist/wrench", time, wrench(time, WORLD, wrist))


def _pictures(path: Path) -> Iterator[Message]:
    with av.open(str(path)) as film:
        for frame in film.decode(video=0):
            height = 2 * round(IMAGE_WIDTH * frame.height / frame.width / 2)
            pixels = frame.reformat(IMAGE_WIDTH, height, "rgb24").to_ndarray()
            yield Message("/camera/image", float(frame.time or 0.0),
                          image(float(frame.time or 0.0), "camera", pixels))

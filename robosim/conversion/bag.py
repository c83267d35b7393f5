"""A run as a bag of ROS 2: joints, wrenches, poses, grains, pictures and the planned motion."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from mpm.files import temporary_path
from robosim.base.errors import ConfigError
from robosim.base.input_files import read_rows, read_text, to_numbers
from robosim.base.progress import Progress
from robosim.config.settings import parse_yaml
from robosim.conversion import messages
from robosim.conversion.joint_log import AXES, MOST_BYTES
from robosim.conversion.messages import STORE
from robosim.recordings.reader import Recording, find_recordings

WORLD = "world"
"""Frame of all poses and grains."""
IMAGE_WIDTH = 640
"""Of pictures [pixels]: larger ones fill a disk without a codec."""
PLUGINS = {"mcap": StoragePlugin.MCAP, "rosbag2": StoragePlugin.SQLITE3}


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
        yield Message("/joint_trajectory", 0.0, messages.joint_trajectory(table))
    if trajectory.is_file():
        yield from _joints(trajectory)
    moving = [body.name for body in recording.header.moving]
    tool = recording.header.tool
    for k in range(len(recording)):
        scene, grains = recording.scene(k), recording.grains(k)
        yield Message("/tf", scene.time, messages.transforms(scene.time, WORLD, dict(zip(moving, scene.poses))))
        if tool:
            yield Message("/grains/wrench", scene.time, messages.wrench(scene.time, WORLD, scene.wrench))
        if recording.header.grains:
            points = np.column_stack([grains.positions, grains.speeds, grains.pressures])
            yield Message("/grains/points", scene.time, messages.point_cloud(scene.time, WORLD, points, [
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
        yield Message("/joint_states", time, messages.joint_state(time, names, q, qd, torque))
        yield Message("/wrist/wrench", time, messages.wrench(time, WORLD, wrist))


def _pictures(path: Path) -> Iterator[Message]:
    with av.open(str(path)) as film:
        for frame in film.decode(video=0):
            height = 2 * round(IMAGE_WIDTH * frame.height / frame.width / 2)
            pixels = frame.reformat(IMAGE_WIDTH, height, "rgb24").to_ndarray()
            yield Message("/camera/image", float(frame.time or 0.0),
                          messages.image(float(frame.time or 0.0), "camera", pixels))

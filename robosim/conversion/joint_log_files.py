"""Reading what a robot recorded of a motion: a CSV file, a bag of ROS, or an episode of a LeRobot dataset."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robosim.base.errors import ConfigError
from robosim.base.input_files import read_rows, to_numbers
from robosim.conversion.joint_log import JointLog, Samples, check_times
from robosim.conversion.lerobot_log import is_lerobot, read_lerobot

AXES = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
WRENCHES = {"wrist": "world", "sensor": "sensor"}
"""First word of the columns of a CSV file -> axes of the wrench."""
MOST_BYTES = 1_000_000_000
"""Of a CSV file: an hour at 1 kHz."""


def read_joint_log(path: Path, joints: Sequence[str], base: str = "world", episode: int = 0) -> JointLog:
    """Read the angles of the named joints, and the wrench if there is one; episode: of a LeRobot dataset.

    A CSV file has columns time_s, q_JOINT_rad, and for a wrench wrist_fx_N .. wrist_tz_Nm in the world's axes or
    sensor_fx_N .. in the sensor's: as `trajectory.csv` of a rehearsal. A bag of ROS 1 or 2 has messages JointState and
    WrenchStamped; a wrench in the frame `world` or `base` is in the world's axes, since arms stand unturned.
    Raises ConfigError for a file without them, or with times that do not increase or have a gap, and for an episode
    of what is no dataset."""
    if not path.exists():
        raise ConfigError(f"{path}: does not exist; accepted: a .csv file, a bag of ROS, or the folder of a LeRobot "
                          f"dataset")
    if is_lerobot(path):
        return check_times(read_lerobot(path, joints, episode))
    if episode:
        raise ConfigError(f"--episode {episode} with {path}; accepted: with a folder of a LeRobot dataset")
    is_csv = path.suffix.lower() == ".csv"
    return check_times(_read_csv(path, joints) if is_csv else _read_bag(path, joints, ("world", base or "world")))


def _read_csv(path: Path, joints: Sequence[str]) -> JointLog:
    rows = read_rows(path, MOST_BYTES, path)
    wrench = next((word for word in WRENCHES if all(f"{word}_{axis}" in rows[0] for axis in AXES)), None)
    table = to_numbers(rows, ["time_s", *(f"q_{joint}_rad" for joint in joints),
                              *(f"{wrench}_{axis}" for axis in (AXES if wrench else ()))], path)
    n = 1 + len(joints)
    readings = None if wrench is None else Samples(table[:, 0], table[:, n:])
    return JointLog(path, Samples(table[:, 0], table[:, 1:n]), readings, WRENCHES[wrench or "wrist"])


def _read_bag(path: Path, joints: Sequence[str], world: Sequence[str]) -> JointLog:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.rosbag2.errors import ReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ConfigError(f"{path}: a bag needs {error.name}: pip install '.[ros]' in the checkout; accepted without "
                          f"it: a .csv file") from None
    states: dict[str, list] = {}
    wrenches: dict[str, list] = {}
    frames: dict[str, str] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            for connection, _, raw in bag.messages():
                kind = connection.msgtype.rsplit("/", 1)[-1]
                if kind not in ("JointState", "WrenchStamped"):
                    continue
                message: Any = bag.deserialize(raw, connection.msgtype)
                stamp = message.header.stamp
                time = stamp.sec + 1e-9 * stamp.nanosec
                if kind == "WrenchStamped":
                    frames[connection.topic] = message.header.frame_id
                    parts = message.wrench.force, message.wrench.torque
                    wrenches.setdefault(connection.topic, []).append([time, *(
                        getattr(part, axis) for part in parts for axis in "xyz")])
                elif set(joints) <= set(message.name) and len(message.position) == len(message.name):
                    order = [list(message.name).index(joint) for joint in joints]
                    states.setdefault(connection.topic, []).append([time, *np.asarray(message.position)[order]])
    except (AnyReaderError, ReaderError, OSError) as error:
        raise ConfigError(f"{path}: {error}; accepted: a .csv file, or a bag of ROS") from None
    if len(states) != 1:
        raise ConfigError(f"{path}: {len(states)} topics of JointState name {', '.join(joints)}"
                          f"{': ' if states else ''}{', '.join(states)}; accepted: one")
    # what grains do is in a bag of ours, too: the wrench on them is not one of the wrist
    chosen = [topic for topic in wrenches if "grains" not in topic]
    if len(chosen) > 1:
        raise ConfigError(f"{path}: {len(chosen)} topics of WrenchStamped: {', '.join(chosen)}; accepted: one, of the "
                          f"wrist")
    (angles,) = states.values()
    if not chosen:
        return JointLog(path, _samples(angles), None)
    axes = "world" if frames[chosen[0]].lstrip("/") in world else "sensor"
    return JointLog(path, _samples(angles), _samples(wrenches[chosen[0]]), axes)


def _samples(rows: list) -> Samples:
    table = np.array(rows, float)
    return Samples(table[:, 0], table[:, 1:])

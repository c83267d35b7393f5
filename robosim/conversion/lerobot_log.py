"""Reading an episode of a LeRobot dataset of version 3 as what a robot recorded of a motion.
Source of the layout: https://huggingface.co/docs/lerobot/lerobot-dataset-v3. Which feature holds the joints, and what
they are called, differs from robot to robot; both are found by the joints' names."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robosim.base.errors import ConfigError
from robosim.base.input_files import read_json
from robosim.conversion.joint_log import JointLog, Samples

INFO = Path("meta") / "info.json"
VERSION = "v3."
WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
ENDINGS = re.compile(r"(\.pos|\.position|_pos|_position|_joint|_rad)+$")
"""What recorders append to a joint's name."""
MOST_TURN = 4.0 * np.pi
"""Angle [rad] beyond which a column is in degrees, or of no joint: a joint turns twice at most."""


class Column(NamedTuple):
    """Where a number of every frame stands."""

    feature: str
    entry: int


def is_lerobot(path: Path) -> bool:
    """Return whether a path is the folder of a LeRobot dataset."""
    return (path / INFO).is_file()


def read_lerobot(path: Path, joints: Sequence[str], episode: int) -> JointLog:
    """Read the angles [rad] of the named joints in an episode, and a wrench in the sensor's axes if there is one.

    A joint's column is the one entry of an observation that has its name, or its name but for what recorders append,
    as in `elbow.pos` or `elbow_joint`. A wrench is a feature whose entries end in fx .. tz, in any case.
    Raises ConfigError for a folder that cannot be read, and for joints or an episode that are not in it."""
    try:
        import pyarrow.parquet as pq  # pyright: ignore[reportMissingImports]
        from pyarrow.lib import ArrowException  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ConfigError(f"{path}: a LeRobot dataset needs pyarrow: pip install '.[lerobot]' in the checkout; "
                          f"accepted without it: a .csv file") from None
    features, total = _read_info(path)
    if not 0 <= episode < total:
        raise ConfigError(f"{path}: episode = {episode}; accepted: 0 to {total - 1}")
    columns = find_joints(features, joints, path)
    wrench = next((name for name, names in features.items()
                   if [entry.lower()[-2:] for entry in names] == list(WRENCH)), None)
    needed = sorted({column.feature for column in columns} | ({wrench} if wrench else set()))
    try:
        table = pq.read_table(path / "data", columns=["timestamp", "episode_index", *needed],
                              filters=[("episode_index", "=", episode)]).to_pydict()
        times = np.array(table["timestamp"], float).ravel()
        values = {name: np.array(table[name], float).reshape(len(times), -1) for name in needed}
        angles = np.column_stack([values[column.feature][:, column.entry] for column in columns])
    except (ArrowException, OSError, KeyError, ValueError, IndexError) as error:
        raise ConfigError(f"{path / 'data'}: {' '.join(str(error).split())[:300]}; accepted: the tables that "
                          f"meta/info.json describes") from None
    if (largest := np.abs(angles).max(initial=0.0)) > MOST_TURN:
        raise ConfigError(f"{path}: episode {episode}: an angle of {largest:.4g}; accepted: radians, up to "
                          f"{MOST_TURN:.4g}; these look like degrees")
    return JointLog(path, Samples(times, angles), Samples(times, values[wrench]) if wrench else None, "sensor")


def find_joints(features: dict[str, list[str]], joints: Sequence[str], path: Path) -> list[Column]:
    """Return the column of each joint, all in one feature, an observation before others.
    features: name -> names of its entries. Raises ConfigError where none has them all, or has one twice."""
    for exact in (True, False):
        for feature in sorted(features, key=lambda name: (not name.startswith("observation"), name)):
            entries = features[feature] if exact else [ENDINGS.sub("", entry.lower()) for entry in features[feature]]
            wanted = joints if exact else [ENDINGS.sub("", joint.lower()) for joint in joints]
            if all(entries.count(joint) == 1 for joint in wanted):
                return [Column(feature, entries.index(joint)) for joint in wanted]
    there = "; ".join(f"{name}: {', '.join(names[:20])}" for name, names in features.items() if names)
    raise ConfigError(f"{path}: no feature has the joints {', '.join(joints)}, each once; there are "
                      f"{there or 'no names'}; accepted: the names of its columns as joint_trajectory.joint_names in "
                      f"the rehearsal's file")


def _read_info(path: Path) -> tuple[dict[str, list[str]], int]:
    """Return the features of a dataset, name -> names of their entries, and the number of its episodes."""
    try:
        info = read_json(path / INFO)
        version = str(info["codebase_version"])
        if not version.startswith(VERSION):
            raise ConfigError(f"{path / INFO}: version {version[:40]!r}; accepted: {VERSION}x, to which LeRobot "
                              f"converts earlier ones")
        return {name: _entry_names(feature) for name, feature in info["features"].items()
                if feature["dtype"] not in ("video", "image", "string")}, int(info["total_episodes"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path / INFO}: {type(error).__name__}: {error}; accepted: meta/info.json of a LeRobot "
                          f"dataset") from None


def _entry_names(feature: dict[str, Any]) -> list[str]:
    """Return the names of a feature's entries; unnamed ones are called by their number. Some recorders put the names
    under a word of their own."""
    names = feature.get("names")
    if isinstance(names, dict):
        names = next(iter(names.values()), None)
    shape = feature["shape"]
    if isinstance(names, list) and len(shape) == 1 and len(names) == shape[0]:
        return [str(name) for name in names]
    return [str(k) for k in range(shape[0])] if len(shape) == 1 else []

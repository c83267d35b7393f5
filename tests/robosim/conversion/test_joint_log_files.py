"""What an arm recorded is read alike from CSV files and bags, and refused by what is wrong with it."""

import csv
from pathlib import Path

import numpy as np
import pytest

from robosim.base.errors import ConfigError
from robosim.conversion.joint_log_files import AXES, read_joint_log

JOINTS = ["shoulder", "elbow"]
TIMES = 5.0 + 0.01 * np.arange(50)
ANGLES = np.column_stack([np.sin(TIMES), np.cos(TIMES)])
WRENCH = np.column_stack([(k + 1) * TIMES for k in range(6)])


def write_csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """Write columns (n,) of a CSV file."""
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([list(columns), *np.column_stack(list(columns.values()))])
    return path


def joint_columns() -> dict[str, np.ndarray]:
    """Return the columns of the joints, in another order than they are asked for."""
    return {"q_elbow_rad": ANGLES[:, 1], "time_s": TIMES, "q_shoulder_rad": ANGLES[:, 0]}


def write_bag(path: Path, frame: str, topics: tuple[str, ...] = ("/joint_states",)) -> Path:
    """Write a bag of ROS 2 with joint states that also name a gripper, and wrenches."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer

    from robosim.conversion.bag import STORE, joint_state, wrench

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        joints = [writer.add_connection(topic, "sensor_msgs/msg/JointState", typestore=STORE) for topic in topics]
        force = writer.add_connection("/ft", "geometry_msgs/msg/WrenchStamped", typestore=STORE)
        for time, q, values in zip(TIMES, ANGLES, WRENCH):
            state = joint_state(time, ["elbow", "gripper", "shoulder"], np.array([q[1], 0.0, q[0]]), np.zeros(3),
                                np.zeros(3))
            for connection in joints:
                writer.write(connection, round(time * 1e9), STORE.serialize_cdr(state, state.__msgtype__))
            message = wrench(time, frame, values)
            writer.write(force, round(time * 1e9), STORE.serialize_cdr(message, message.__msgtype__))
    return path


@pytest.mark.parametrize(("word", "axes"), [("wrist", "world"), ("sensor", "sensor")])
def test_a_csv_file_is_read_by_its_columns(word: str, axes: str, tmp_path: Path) -> None:
    wrench = {f"{word}_{axis}": WRENCH[:, k] for k, axis in enumerate(AXES)}
    log = read_joint_log(write_csv(tmp_path / "real.csv", joint_columns() | wrench), JOINTS)
    np.testing.assert_array_equal(log.joints.times, TIMES)
    np.testing.assert_array_equal(log.joints.values, ANGLES)
    assert log.wrench is not None and log.wrench_axes == axes
    np.testing.assert_array_equal(log.wrench.values, WRENCH)


@pytest.mark.parametrize(("frame", "axes"), [("world", "world"), ("tool0", "sensor"), ("arm_base", "world")])
def test_a_bag_is_read_by_its_messages(frame: str, axes: str, tmp_path: Path) -> None:
    log = read_joint_log(write_bag(tmp_path / "bag", frame), JOINTS, base="arm_base")
    np.testing.assert_allclose(log.joints.times, TIMES, atol=1e-9)
    np.testing.assert_array_equal(log.joints.values, ANGLES)
    assert log.wrench is not None and log.wrench_axes == axes
    np.testing.assert_array_equal(log.wrench.values, WRENCH)


def test_a_file_without_a_wrench_has_none(tmp_path: Path) -> None:
    assert read_joint_log(write_csv(tmp_path / "real.csv", joint_columns()), JOINTS).wrench is None


def test_wrong_files_are_refused_by_what_is_wrong(tmp_path: Path) -> None:
    columns = joint_columns()
    cases = {
        "no column q_elbow_rad among time_s, q_shoulder_rad": {k: v for k, v in columns.items() if "elbow" not in k},
        "sample 11 comes -0.99 s after": columns | {"time_s": TIMES - 1.0 * (np.arange(50) >= 10)},
        "sample 21 comes 1.01 s after": columns | {"time_s": TIMES + 1.0 * (np.arange(50) >= 20)},
        "sample 4 is not finite": columns | {"q_elbow_rad": np.where(np.arange(50) == 3, np.nan, ANGLES[:, 1])},
        "joint angles: 5 samples": {k: v[:5] for k, v in columns.items()},
    }
    for message, given in cases.items():
        with pytest.raises(ConfigError, match=message):
            read_joint_log(write_csv(tmp_path / "real.csv", given), JOINTS)
    (tmp_path / "text.csv").write_text("time_s,q_shoulder_rad,q_elbow_rad\n0.0,0.1,x\n")
    with pytest.raises(ConfigError, match="line 2: "):
        read_joint_log(tmp_path / "text.csv", JOINTS)
    with pytest.raises(ConfigError, match=r"does not exist; accepted: a \.csv file"):
        read_joint_log(tmp_path / "none.csv", JOINTS)


def test_a_bag_with_two_arms_names_their_topics(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "world", ("/left/joint_states", "/right/joint_states"))
    with pytest.raises(ConfigError, match="2 topics of JointState name shoulder, elbow: /left.*, /right"):
        read_joint_log(bag, JOINTS)
    with pytest.raises(ConfigError, match="0 topics of JointState name wrist; accepted: one"):
        read_joint_log(bag, ["wrist"])
    (tmp_path / "no_bag").mkdir()
    with pytest.raises(ConfigError, match=r"accepted: a \.csv file, or a bag"):
        read_joint_log(tmp_path / "no_bag", JOINTS)


def test_cells_of_a_table_may_be_quoted(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text('"time_s", "q_a, left_rad"\n' + "".join(f'{k / 10},"{k}.5"\n' for k in range(12)))
    assert read_joint_log(path, ["a, left"]).joints.values.ravel().tolist() == [k + 0.5 for k in range(12)]
    path.write_text('"time_s","q_a\n1,2\n')
    with pytest.raises(ConfigError, match=r"log.csv: cannot be read: "):
        read_joint_log(path, ["a"])

"""An episode of a LeRobot dataset is read as a recording, whatever its robot calls its joints."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robosim.base.errors import ConfigError
from robosim.conversion.lerobot_log import read_lerobot

pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
JOINTS = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"]
LENGTHS = (30, 40)


def write_dataset(folder: Path, features: dict[str, Any], **changes: Any) -> dict[str, np.ndarray]:
    """Write two episodes in two files, at 10 frames a second, as recorders do; return their values (frames, entries).
    features: name -> names of its entries. changes: of meta/info.json."""
    count = sum(LENGTHS)
    info = {"codebase_version": "v3.0", "robot_type": "ur3e", "total_episodes": 2, "fps": 10, "features": {
        name: {"dtype": "float32", "names": names, "shape": [6 if names is None else len(
            names if isinstance(names, list) else names["motors"])]} for name, names in features.items()}} | changes
    info["features"] |= {"observation.images.top": {"dtype": "video", "shape": [48, 64, 3], "names": None}}
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    rng = np.random.default_rng(0)
    shapes = {name: (count, *info["features"][name]["shape"]) for name in features}
    values = {name: np.cumsum(rng.normal(0.0, 0.02, shape), 0) for name, shape in shapes.items()}
    episode = np.repeat([0, 1], LENGTHS)
    frame = np.concatenate([np.arange(n) for n in LENGTHS])
    for number in (0, 1):
        rows = episode == number
        path = folder / "data" / "chunk-000" / f"file-{number:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.table({"timestamp": pa.array((frame[rows] / 10.0).astype(np.float32)),
                                 "episode_index": pa.array(episode[rows]), **{
                                     name: pa.array(part[rows].tolist(), pa.list_(pa.float32()))
                                     for name, part in values.items()}}), path)
    return {name: part[episode == 1] for name, part in values.items()}


@pytest.mark.parametrize(("feature", "names", "order"), [
    ("observation.state", ["elbow.pos", "gripper.pos", "shoulder_pan.pos", "shoulder_lift.pos"], [2, 3, 0]),
    ("observation.joints", JOINTS, [0, 1, 2]),
    ("observation.state", {"motors": ["shoulder_pan", "shoulder_lift", "elbow"]}, [0, 1, 2])])
def test_joints_are_found_by_their_names(feature: str, names: Any, order: list[int], tmp_path: Path) -> None:
    """With and without what recorders append, among actions with the same names, in the episode that is asked for."""
    values = write_dataset(tmp_path, {"action": names, feature: names})
    log = read_lerobot(tmp_path, JOINTS, 1)
    np.testing.assert_allclose(log.joints.values, values[feature][:, order], atol=1e-6)
    np.testing.assert_allclose(log.joints.times, np.arange(LENGTHS[1]) / 10.0, atol=1e-6)
    assert log.wrench is None


def test_a_wrench_is_in_the_axes_of_the_sensor(tmp_path: Path) -> None:
    values = write_dataset(tmp_path, {"observation.state": JOINTS, "observation.force": [
        "Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]})
    log = read_lerobot(tmp_path, JOINTS, 1)
    assert log.wrench is not None and log.wrench_axes == "sensor"
    np.testing.assert_allclose(log.wrench.values, values["observation.force"], atol=1e-6)


def test_two_arms_and_unnamed_columns_are_told_apart_by_exact_names(tmp_path: Path) -> None:
    both = [f"{side}_{joint.removesuffix('_joint')}.pos" for side in ("left", "right") for joint in JOINTS]
    values = write_dataset(tmp_path / "two", {"observation.state": both})
    with pytest.raises(ConfigError, match=r"no feature has the joints shoulder_pan_joint, .*: left_shoulder_pan.pos"):
        read_lerobot(tmp_path / "two", JOINTS, 0)
    log = read_lerobot(tmp_path / "two", both[3:], 1)
    np.testing.assert_allclose(log.joints.values, values["observation.state"][:, 3:], atol=1e-6)
    values = write_dataset(tmp_path / "none", {"observation.state": None})
    log = read_lerobot(tmp_path / "none", ["2", "1", "0"], 1)
    np.testing.assert_allclose(log.joints.values, values["observation.state"][:, [2, 1, 0]], atol=1e-6)


def test_wrong_datasets_are_refused_by_what_is_wrong(tmp_path: Path) -> None:
    write_dataset(tmp_path / "set", {"observation.state": JOINTS})
    with pytest.raises(ConfigError, match=r"set: episode = 2; accepted: 0 to 1"):
        read_lerobot(tmp_path / "set", JOINTS, 2)
    write_dataset(tmp_path / "old", {"observation.state": JOINTS}, codebase_version="v2.1")
    with pytest.raises(ConfigError, match=r"version 'v2.1'; accepted: v3"):
        read_lerobot(tmp_path / "old", JOINTS, 0)
    (tmp_path / "set" / "data" / "chunk-000" / "file-001.parquet").write_bytes(b"cut off")
    with pytest.raises(ConfigError, match=r"data: .*; accepted: the tables that meta/info.json describes"):
        read_lerobot(tmp_path / "set", JOINTS, 1)
    (tmp_path / "set" / "meta" / "info.json").write_text("{}")
    with pytest.raises(ConfigError, match=r"info.json: .*codebase_version.*; accepted: meta/info.json of a LeRobot"):
        read_lerobot(tmp_path / "set", JOINTS, 0)


def test_degrees_are_not_taken_for_radians(tmp_path: Path) -> None:
    write_dataset(tmp_path, {"observation.state": JOINTS})
    path = tmp_path / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(path).to_pydict()
    table["observation.state"] = [[90.0, 0.0, 0.0]] * LENGTHS[0]
    pq.write_table(pa.table(table), path)
    with pytest.raises(ConfigError, match=r"an angle of 90; accepted: radians, up to 12.57; these look like degrees"):
        read_lerobot(tmp_path, JOINTS, 0)

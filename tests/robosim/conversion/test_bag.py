"""Other tools read of a run what it has: bags by rosbags, a frame by trimesh."""

import csv
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from robosim.base.errors import ConfigError
from robosim.commands.main import main
from robosim.conversion.gltf import write_frame
from robosim.recordings.frames import GrainState, SceneState
from robosim.recordings.header import VERSION, BodyEntry, RecordingHeader
from robosim.recordings.reader import Recording
from robosim.recordings.writer import RecordingWriter
from robosim.rehearsal.readings import name_columns
from robosim.rendering.body_shapes import export_glb
from robosim.rendering.video import Mp4Writer

FRAMES, ROWS, GRAINS = 6, 40, 300
NAMES = [f"A{k}" for k in range(1, 8)]


def positions(k: int) -> np.ndarray:
    """Return the grains of the k-th frame (n, 3) [m]."""
    return np.random.default_rng(0).uniform(0.0, 0.2, (GRAINS, 3)) + [0.0, 0.0, 0.01 * k]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Return the folder of a short run: a box that rises, grains, joints, a film and a planned motion."""
    folder = tmp_path / "run"
    folder.mkdir()
    header = RecordingHeader(
        version=VERSION, kind="rehearsal", title="a box", frame_rate=20.0, grains=GRAINS, grain_radius=1e-3,
        colour=(0.9, 0.8, 0.7), lower=(0, 0, 0), upper=(0.4, 0.4, 0.4), tool="box",
        bodies=[BodyEntry(name="box", moves=True, position=(0, 0, 0), quaternion=(1, 0, 0, 0)),
                BodyEntry(name="table", moves=False, position=(0, 0, -0.5), quaternion=(1, 0, 0, 0))])
    shapes = {"box": export_glb(trimesh.Scene(trimesh.creation.box((0.1, 0.1, 0.1)))),
              "table": export_glb(trimesh.Scene(trimesh.creation.box((1.0, 1.0, 0.1))))}
    writer = RecordingWriter(folder / "recording.rec", header, shapes)
    for k in range(FRAMES):
        writer.add(SceneState(0.05 * k, np.array([[0, 0, 0.1 * k, 1, 0, 0, 0]]), np.arange(6.0) + k, np.zeros(0)),
                   GrainState(positions(k), np.full(GRAINS, 0.5), np.full(GRAINS, 1e3), np.ones(GRAINS, bool)))
    writer.close()
    values = np.random.default_rng(1).normal(size=(ROWS, len(name_columns(NAMES))))
    values[:, 0] = 1e-3 * np.arange(1, ROWS + 1)
    with (folder / "trajectory.csv").open("w", newline="") as file:
        csv.writer(file).writerows([name_columns(NAMES), *values])
    point = {"positions": [0.1] * 7, "velocities": [0.2] * 7, "accelerations": [0.3] * 7,
             "time_from_start": {"sec": 1, "nanosec": 500}}
    (folder / "joint_trajectory.yaml").write_text(yaml.safe_dump({
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base"}, "joint_names": NAMES, "points": [point]}))
    with Mp4Writer(folder / "rehearsal.mp4", fps=20) as film:
        for k in range(FRAMES):
            film.add(np.full((72, 128, 3), 40 * k, np.uint8))
    return folder


@pytest.mark.parametrize("kind", ["mcap", "rosbag2"])
def test_a_bag_has_what_the_run_has(kind: str, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Reader

    from robosim.conversion.bag import STORE

    assert main(["convert", str(run), "--to", kind, "--out", str(tmp_path / "bag")]) == 0
    with Reader(tmp_path / "bag") as reader:
        read = [(connection.topic, time, STORE.deserialize_cdr(raw, connection.msgtype))
                for connection, time, raw in reader.messages()]
    by_topic: dict[str, list] = {}
    for topic, time, message in read:
        by_topic.setdefault(topic, []).append((time, message))
    printed = dict(line.split()[:2] for line in capsys.readouterr().out.splitlines())
    assert printed == {topic: str(len(messages)) for topic, messages in by_topic.items()}
    assert {topic: len(messages) for topic, messages in by_topic.items()} == {
        "/joint_trajectory": 1, "/joint_states": ROWS, "/wrist/wrench": ROWS, "/tf": FRAMES, "/grains/wrench": FRAMES,
        "/grains/points": FRAMES, "/camera/image": FRAMES}
    table = np.loadtxt(run / "trajectory.csv", delimiter=",", skiprows=1)
    column = {name: k for k, name in enumerate(name_columns(NAMES))}
    for row, (time, state) in zip(table, by_topic["/joint_states"]):
        assert time == round(1e9 * row[0]) and state.name == NAMES
        assert np.allclose(state.position, [row[column[f"q_{name}_rad"]] for name in NAMES])
        assert np.allclose(state.effort, [row[column[f"sensed_torque_{name}_Nm"]] for name in NAMES])
    assert by_topic["/wrist/wrench"][5][1].wrench.force.z == pytest.approx(table[5, column["wrist_fz_N"]])
    for k, (time, cloud) in enumerate(by_topic["/grains/points"]):
        points = cloud.data.view("<f4").reshape(GRAINS, 5)
        assert time == round(5e7 * k) and [field.name for field in cloud.fields][:3] == ["x", "y", "z"]
        assert np.abs(points[:, :3] - positions(k)).max() < 1e-5 and cloud.point_step == 20
        frame = by_topic["/tf"][k][1].transforms[0]
        assert frame.child_frame_id == "box" and frame.transform.translation.z == pytest.approx(0.1 * k, abs=1e-6)
        assert by_topic["/grains/wrench"][k][1].wrench.torque.z == pytest.approx(5.0 + k)
    picture = by_topic["/camera/image"][3][1]
    assert (picture.width, picture.height, picture.step) == (640, 360, 1920)
    assert abs(int(np.median(picture.data)) - 120) < 6
    planned = by_topic["/joint_trajectory"][0][1]
    assert planned.joint_names == NAMES and planned.points[0].time_from_start.nanosec == 500


def test_a_bag_is_whole_or_not_there(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags")
    text = (run / "trajectory.csv").read_text().splitlines()
    (run / "trajectory.csv").write_text("\n".join([*text[:20], text[20].replace(",", ",x", 1), *text[21:]]))
    assert main(["convert", str(run), "--to", "mcap", "--out", str(tmp_path / "bag")]) == 2
    assert "trajectory.csv: line 21" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    (tmp_path / "bag").mkdir()
    assert main(["convert", str(run), "--to", "mcap", "--out", str(tmp_path / "bag")]) == 2
    assert "exists; accepted: a new folder" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "bag"), "--to", "mcap", "--out", str(tmp_path / "other")]) == 2
    assert "holds no recording" in capsys.readouterr().err


def test_a_frame_has_bodies_and_grains_where_they_were(run: Path, tmp_path: Path) -> None:
    with Recording(run / "recording.rec") as recording:
        assert write_frame(recording, 0.21, tmp_path / "frame.glb") == pytest.approx(0.2)
    scene = trimesh.load(tmp_path / "frame.glb")
    assert isinstance(scene, trimesh.Scene)
    boxes = {}
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        corners = trimesh.transform_points(scene.geometry[name].vertices, transform)
        boxes[node.split("/")[0]] = np.array([corners.min(0), corners.max(0)])
    assert np.allclose(boxes["box"], [[-0.05, -0.05, 0.35], [0.05, 0.05, 0.45]], atol=1e-5)
    assert np.allclose(boxes["table"][1], [0.5, 0.5, -0.45], atol=1e-5)
    expected = np.array([positions(4).min(0) - 1e-3, positions(4).max(0) + 1e-3])
    assert np.abs(boxes["grains"] - expected).max() < 3e-4


def test_what_cannot_be_converted_is_refused(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["convert", str(run), "--to", "glb", "--out", str(tmp_path / "frame.obj")]) == 2
    assert "a file that ends in .glb" in capsys.readouterr().err
    (run / "recording.rec").unlink()
    assert main(["convert", str(run), "--to", "glb", "--out", str(tmp_path / "frame.glb")]) == 2
    assert "holds no recording" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="cannot be read"):
        Recording(run / "recording.rec")

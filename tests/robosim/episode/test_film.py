"""A film is drawn from a recording: what it shows, its files, and what it cannot be drawn from."""

import errno
import os
from pathlib import Path
from types import SimpleNamespace

import av
import mujoco
import numpy as np
import pytest
from PIL import Image

from robosim.base.errors import ConfigError, UnknownName
from robosim.commands.main import main
from robosim.episode.cameras import ASPECT, FOVY_DEG, follow_tool, frame
from robosim.episode.film import FilmFailed, FilmStyle, Pictures, film_run
from robosim.episode.sheet import LOAD, name_passage
from robosim.recordings.frames import GrainState, SceneState
from robosim.recordings.header import VERSION, BodyEntry, CurveEntry, RecordingHeader, RegionEntry, WaypointEntry
from robosim.recordings.reader import Recording
from robosim.recordings.scene_recorder import SceneRecorder
from robosim.recordings.writer import RecordingWriter
from robosim.rendering.renderer import SceneRenderer

SCENE = """<mujoco>
<visual><headlight ambient="0.4 0.4 0.4" diffuse="0.5 0.5 0.5"/></visual>
<asset><texture name="dots" type="2d" builtin="checker" width="32" height="32" rgb1="0.8 0.5 0.2" rgb2="0.4 0.3 0.1"/>
  <material name="dots" texture="dots" texrepeat="3 3" specular="0.9"/><material name="red" rgba="0.7 0.1 0.1 1"/>
  <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  <hfield name="hills" nrow="8" ncol="8" size="0.4 0.4 0.03 0.01"/></asset>
<worldbody>
  <light pos="0.3 0.2 1.5" dir="0 0 -1" castshadow="true"/>
  <camera name="close" pos="0.6 -0.5 0.5" mode="targetbody" target="aim"/><body name="aim" pos="0 0 0.1"/>
  <geom type="plane" size="1 1 0.1" material="dots"/>
  <body name="arm" pos="0 0 0.2"><joint type="hinge" axis="0 0 1"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.15 0 0" rgba="0.2 0.7 0.3 1"/>
    <body name="tool" pos="0.2 0 0"><joint type="hinge" axis="1 0 0"/>
      <geom type="mesh" mesh="wedge" material="red"/><camera name="hand_wrist" pos="0 0 0.3"/></body></body>
  <geom type="hfield" hfield="hills" pos="-0.5 0 0" rgba="0.6 0.5 0.4 1"/>
</worldbody></mujoco>"""
HILLS = np.random.default_rng(0).permutation(np.linspace(0.0, 1.0, 64))
FRAMES = 12
RATE = 20


class RisingGrains:
    """Stands for a solver whose 60 grains rise."""

    grid = SimpleNamespace(lower=np.full(3, -1.0), cells=np.full(3, 20), cell=0.1)
    particles = SimpleNamespace(counts=(60,))
    awake = np.ones(60, bool)
    height = 0.05

    def positions(self) -> np.ndarray:
        grid = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), -1).reshape(-1, 3)[:60]
        return np.array([-0.05, 0.1, self.height]) + 0.02 * grid

    def velocities(self) -> np.ndarray:
        return np.zeros((60, 3))

    def stresses(self) -> np.ndarray:
        return np.zeros((60, 3, 3))


def record(path: Path, kind: str = "rehearsal", frames: int = FRAMES) -> mujoco.MjData:
    """Record the turning arm and the rising grains; return the last state."""
    path.parent.mkdir(exist_ok=True)
    model = mujoco.MjModel.from_xml_string(SCENE)
    model.hfield_data[:] = HILLS
    data, grains = mujoco.MjData(model), RisingGrains()
    mujoco.mj_forward(model, data)
    recorder = SceneRecorder(path, model, data, grains, kind=kind, title="", caption="salt",  # pyright: ignore[reportArgumentType]
                             frame_rate=RATE, grain_volume=8e-6, tool="tool", hand="arm",
                             curves=[CurveEntry(name=LOAD, unit="g", chart="mass")],
                             waypoints=[WaypointEntry(name="dig", time=0.1, position=(0.0, 0.0, 0.0))],
                             regions=[RegionEntry(name="area", position=(0.2, 0.3, 0.0), half=(0.05, 0.05, 0.01),
                                                  is_marked=True)])
    for k in range(frames):
        data.time, data.qpos[:], grains.height = k / RATE, (0.1 * k, 0.05 * k), 0.05 + 0.01 * k
        mujoco.mj_forward(model, data)
        recorder.add(data, lambda _, k=k: [min(k, 6.0)])
    recorder.close()
    return data


def read_film(path: Path) -> list[np.ndarray]:
    """Read the frames (height, width, 3) of a film."""
    with av.open(str(path)) as film:
        return [frame.to_ndarray(format="rgb24").astype(int) for frame in film.decode(video=0)]


def test_a_recorded_scene_looks_like_the_simulated_one(tmp_path: Path) -> None:
    """Meshes, textures, height fields, lights and cameras, also those of moving bodies."""
    data = record(tmp_path / "recording.rec")
    spec = mujoco.MjSpec.from_string(SCENE)
    model = spec.compile()
    model.hfield_data[:] = HILLS
    for camera, name in (("close", "close"), ("wrist", "hand_wrist")):
        renderer = SceneRenderer(model, 0, 640, 360)
        expected = renderer.draw(data, None, name).astype(int)
        renderer.close()
        with Recording(tmp_path / "recording.rec") as recording:
            hidden = recording.header.model_copy(update={"grains": 0, "regions": []})
            recording._header, recording.grains = hidden, lambda k: GrainState(*4 * [np.zeros((0, 3))])
            with Pictures(recording, FilmStyle(camera, height=360, renderer="classic")) as pictures:
                drawn = pictures.draw(FRAMES - 1).astype(int)
                one_by_one = dict(pictures.draw_all(range(FRAMES)))
                assert all((np.abs(pictures.draw(k).astype(int) - one).max(2) > 8).mean() < 1e-3
                           for k, one in one_by_one.items())
        assert np.ptp(expected) > 100 and (np.abs(drawn - expected).max(2) > 8).mean() < 1e-3, camera


def test_a_film_has_all_frames_and_a_sheet_and_a_poster(tmp_path: Path) -> None:
    record(tmp_path / "run" / "recording.rec")
    assert film_run(tmp_path / "run") == tmp_path / "run" / "rehearsal.mp4"
    frames = read_film(tmp_path / "run" / "rehearsal.mp4")
    assert len(frames) == FRAMES and frames[0].shape == (720, 1280, 3)
    assert 200 < (np.abs(frames[-1] - frames[0]).max(2) > 60).sum() < 0.4 * 720 * 1280
    assert {p.name for p in (tmp_path / "run").iterdir()} == {"recording.rec", "rehearsal.mp4", "frames.png"}
    style = FilmStyle("orbit", height=90, poster=0.3)
    film_run(tmp_path / "run", tmp_path, style)
    assert read_film(tmp_path / "rehearsal.mp4")[0].shape == (90, 160, 3)
    with Image.open(tmp_path / "poster.png") as poster:
        assert poster.size == (3840, 2160)


def test_a_film_of_a_part_has_its_frames_and_no_sheet(tmp_path: Path) -> None:
    """Both ends belong to it; a time after the end is refused with those that there are."""
    record(tmp_path / "run" / "recording.rec")
    film_run(tmp_path / "run", tmp_path, FilmStyle("close", height=90, begin=0.1, end=0.3))
    assert len(read_film(tmp_path / "rehearsal.mp4")) == 5
    assert not (tmp_path / "frames.png").exists()
    with pytest.raises(ConfigError, match=r"no frames from 7 to 8 s; accepted: times of 0.00 to 0.55 s"):
        film_run(tmp_path / "run", tmp_path, FilmStyle("close", begin=7.0, end=8.0))


def test_a_camera_that_frames_shows_all_points_and_no_more_room_than_it_needs() -> None:
    points = np.random.default_rng(0).uniform((-0.5, -0.4, 0.0), (0.8, 0.9, 1.1), (200, 3))
    for azimuth in (30.0, 152.0, 250.0):
        camera = frame(points, azimuth)
        a, e = np.radians((azimuth, camera.elevation))
        forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([np.sin(a), -np.cos(a), 0.0])
        seen = points - (camera.lookat - camera.distance * forward)
        x, y = (seen @ axis / (seen @ forward) / np.tan(np.radians(FOVY_DEG / 2))
                for axis in (right / ASPECT, np.cross(right, forward)))
        assert 0.9 < max(np.abs(x).max(), np.abs(y).max()) < 1.0 and (seen @ forward > 0).all()


def test_waypoints_after_a_dose_are_named_once_it_is_over(tmp_path: Path) -> None:
    """Their times are known only then: the recording has them after its frames."""
    data = mujoco.MjData(model := mujoco.MjModel.from_xml_string(SCENE))
    recorder = SceneRecorder(tmp_path / "a.rec", model, data, None, kind="rehearsal", title="a dose", waypoints=[
        WaypointEntry(name=name, time=time, position=(0.0, 0.0, 0.0)) for name, time in (("over", 1.0), ("dose", 2.0))])
    recorder.writer.add(SceneState(0.0, np.zeros((2, 7)), np.zeros(6), np.zeros(0)), GrainState(
        np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, bool)))
    recorder.writer.add_waypoints([WaypointEntry(name="back", time=23.0, position=(0.0, 0.0, 0.0))])
    recorder.close()
    with Recording(tmp_path / "a.rec") as recording:
        assert [name_passage(recording, t) for t in (0.5, 1.5, 9.0, 24.0)] == ["grasp", "over", "dose", "back"]


def test_the_command_films_a_chain_and_an_unfinished_run(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for k in (1, 2):
        record(tmp_path / "chain" / f"{k}-Task.rec", "task", 3)
    small = ["--height", "144", "--camera", "close"]
    assert main(["film", str(tmp_path / "chain"), *small]) == 0
    assert len(read_film(tmp_path / "chain" / "chain.mp4")) == 6
    assert main(["film", str(tmp_path / "chain" / "2-Task.rec"), *small, "--out", str(tmp_path / "one")]) == 0
    assert capsys.readouterr().out.split()[-1] == str(tmp_path / "one" / "2-Task.mp4")
    record(tmp_path / "cut" / "recording.rec", frames=3)
    os.rename(tmp_path / "cut" / "recording.rec", tmp_path / "cut" / "recording.rec.part")
    assert main(["film", str(tmp_path / "cut"), *small]) == 0
    assert len(read_film(tmp_path / "cut" / "rehearsal.mp4")) == 3


def test_what_cannot_be_drawn_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match=r"empty: holds no recording.rec \(nothing\); accepted: the folder of a run"):
        film_run(tmp_path / "empty")
    record(tmp_path / "recording.rec", frames=1)
    with Recording(tmp_path / "recording.rec") as recording:
        recording.appearance = recording.appearance[:-2000]
        with pytest.raises(ConfigError, match=r"recording.rec: damaged: what its scene looks like: .*record the run"):
            Pictures(recording, FilmStyle())
    with pytest.raises(UnknownName, match="unknown camera 'top'; valid: auto, close, near, orbit, wrist"):
        film_run(tmp_path, style=FilmStyle("top"))

    def fill(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("robosim.episode.film.Mp4Writer.add", fill)
    with pytest.raises(FilmFailed, match="no film: .*No space left"):
        film_run(tmp_path)
    assert [path.name for path in tmp_path.glob("*.*")] == ["recording.rec"]


@pytest.mark.parametrize(("axis", "opens"), [((1.0, 0.0, 0.0), (0.0, -1.0)), ((0.0, -1.0, 0.0), (-1.0, 0.0)),
                                             (None, (0.0, 1.0))])
def test_the_near_camera_follows_the_tool_and_looks_into_it(
        axis: tuple[float, float, float] | None, opens: tuple[float, float], tmp_path: Path) -> None:
    """A bowl that moves along y and tips about an axis; an upright one is seen from the side to which it moves."""
    none = GrainState(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, bool))
    header = RecordingHeader(
        version=VERSION, kind="scene", title="", frame_rate=10.0, grains=0, grain_radius=0.01, colour=(0.9, 0.8, 0.7),
        lower=(-1, -1, -1), upper=(1, 1, 1), tool="bowl",
        regions=[RegionEntry(name="inside", body="bowl", position=(0.0, 0.0, 0.05), half=(0.03, 0.03, 0.03)),
                 RegionEntry(name="tub", position=(0.0, 0.4, 0.0), half=(0.1, 0.1, 0.05))],
        bodies=[BodyEntry(name="bowl", moves=True, position=(0, 0, 0), quaternion=(1, 0, 0, 0))])
    writer = RecordingWriter(tmp_path / "recording.rec", header, {})
    for k in range(31):
        turn = np.array(axis or (0.0, 0.0, 1.0)) * np.sin(np.radians(max(k - 20, 0) * 9.0 / 2.0))
        pose = [0, 0.02 * k, 0.3, np.cos(np.radians(max(k - 20, 0) * 9.0 / 2.0)), *turn]
        writer.add(SceneState(0.1 * k, np.array([pose]), np.zeros(6), np.zeros(0)), none)
    writer.close()
    with Recording(tmp_path / "recording.rec") as recording:
        camera = follow_tool(recording)
    first, last = camera(0.0), camera(3.0)
    assert last.lookat[1] - first.lookat[1] == pytest.approx(0.55, abs=0.1) and first.azimuth == last.azimuth
    sight = np.array([np.cos(np.radians(last.azimuth)), np.sin(np.radians(last.azimuth))])
    assert sight @ opens == pytest.approx(-np.cos(np.radians(55.0)))
    assert last.distance * np.tan(np.radians(FOVY_DEG / 2)) * ASPECT * 2 == pytest.approx(3.1 * 0.2)

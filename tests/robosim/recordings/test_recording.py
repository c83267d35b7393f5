"""A recording is what was given to it, within its resolution, however its run ended."""

from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import zstandard

from robosim.base.errors import ConfigError
from robosim.recordings.frames import KEY_INTERVAL, PRESSURES, SPEEDS, GrainState, SceneState
from robosim.recordings.header import VERSION, BodyEntry, CurveEntry, RecordingHeader
from robosim.recordings.reader import Recording, find_recordings
from robosim.recordings.writer import BLOCK, HEADER, MAGIC, SHAPE, WAYPOINTS, RecordingWriter

LOWER, UPPER = np.array([-0.2, 0.1, 0.0]), np.array([0.6, 0.5, 0.3])
GRAINS, FRAMES = 700, 2 * KEY_INTERVAL + 3


def header(**changes: object) -> RecordingHeader:
    """Return the header of a scene with one moving body and two curves."""
    bodies = [BodyEntry(name="table", moves=False, position=(0, 0, 0), quaternion=(1, 0, 0, 0)),
              BodyEntry(name="spoon", moves=True, position=(0, 0, 0.2), quaternion=(1, 0, 0, 0))]
    values = {"version": VERSION, "kind": "scene", "title": "a test", "frame_rate": 20.0, "grains": GRAINS,
              "grain_radius": 1e-3, "colour": (0.8, 0.7, 0.6), "lower": tuple(LOWER), "upper": tuple(UPPER),
              "bodies": bodies, "tool": "spoon", "curves": [CurveEntry(name="a", unit="g", chart="mass"),
                                                            CurveEntry(name="b", unit="N", chart="force")]}
    return RecordingHeader(**{**values, **changes})


def frames() -> list[tuple[SceneState, GrainState]]:
    """Return frames in which some grains move, some rest, and a few leave the box."""
    rng = np.random.default_rng(1)
    x = rng.uniform(LOWER, UPPER, (GRAINS, 3))
    result = []
    for k in range(FRAMES):
        x[: GRAINS // 2] += rng.normal(0.0, 1e-3, (GRAINS // 2, 3))
        quaternion = rng.normal(size=4)
        pose = np.concatenate([rng.normal(size=3), quaternion / np.linalg.norm(quaternion)])
        scene = SceneState(0.05 * k, pose[None], rng.normal(size=6), np.array([k, np.nan if k == 0 else 0.1 * k]))
        result.append((scene, GrainState(x.copy(), rng.uniform(0, 3, GRAINS), 10.0 ** rng.uniform(-1, 5, GRAINS),
                                         rng.uniform(size=GRAINS) < 0.3)))
    return result


def write(path: Path, **changes: object) -> RecordingWriter:
    """Write a recording of these frames, without its end."""
    writer = RecordingWriter(path, header(**changes), {"spoon": b"shape"}, {"commanded": np.eye(3)})
    for scene, grains in frames():
        writer.add(scene, grains)
    return writer


def test_a_recording_is_what_was_recorded_within_its_resolution(opened: Callable[[Path], Recording],
                                                                tmp_path: Path) -> None:
    write(tmp_path / "recording.rec").close()
    recording = opened(tmp_path / "recording.rec")
    assert len(recording) == FRAMES and recording.is_finished and recording.header == header()
    assert recording.shapes == {"spoon": b"shape"} and np.array_equal(recording.paths["commanded"], np.eye(3))
    resolution = (UPPER - LOWER) / 65535
    for k in (FRAMES - 1, 0, KEY_INTERVAL, KEY_INTERVAL - 1, 3):  # in any order
        scene, grains = frames()[k]
        seen, there = recording.scene(k), recording.grains(k)
        assert seen.time == scene.time and np.allclose(seen.poses, scene.poses, atol=1e-6)
        assert np.allclose(seen.wrench, scene.wrench, atol=1e-6)
        assert np.allclose(seen.values, scene.values, rtol=1e-6, equal_nan=True)
        inside = np.clip(grains.positions, LOWER, UPPER)
        assert np.abs(there.positions - inside).max() <= 0.5 * resolution.max() + 1e-7
        assert np.array_equal(there.awake, grains.awake)
        for values, read, (low, high) in ((grains.speeds, there.speeds, SPEEDS),
                                          (grains.pressures, there.pressures, PRESSURES)):
            step = (high / low) ** (1 / 254)
            measured = values >= low
            assert np.all(read[~measured] == 0.0)
            assert np.all(np.abs(np.log(read[measured] / values[measured])) <= 0.51 * np.log(step))


def test_a_recording_is_followed_while_it_is_written(opened: Callable[[Path], Recording], tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "recording.rec", header(), {})
    part, = find_recordings(tmp_path)
    assert part is not None and part.name == "recording.rec.part"
    recording, all_frames = opened(part), frames()
    for n, (scene, grains) in enumerate(all_frames[:30], 1):
        writer.add(scene, grains)
        assert recording.refresh() == 1 and len(recording) == n and not recording.is_finished
        assert np.abs(recording.grains(n - 1).positions - np.clip(grains.positions, LOWER, UPPER)).max() < 1e-5
    writer.close()
    assert recording.is_finished and recording.refresh() == 0
    assert find_recordings(tmp_path) == [tmp_path / "recording.rec"]


def test_what_was_written_before_a_crash_is_read(tmp_path: Path) -> None:
    """Cut anywhere, a file has all frames that were whole before."""
    write(tmp_path / "recording.rec").close()
    content = (tmp_path / "recording.rec").read_bytes()
    counts = []
    for size in np.linspace(4000, len(content), 25).astype(int):
        cut = tmp_path / "recording.rec.part"
        cut.write_bytes(content[:size])
        recording = Recording(cut)
        counts.append(len(recording))
        if counts[-1]:
            assert np.abs(recording.grains(counts[-1] - 1).positions
                          - np.clip(frames()[counts[-1] - 1][1].positions, LOWER, UPPER)).max() < 1e-5
        recording.close()
    assert counts == sorted(counts) and counts[-1] == FRAMES and counts[0] < 3


def test_an_interrupt_leaves_a_recording_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Raised while it is begun, and between its end and its name; whoever records then closes it once more."""
    writer = write(tmp_path / "recording.rec")
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(Path, "replace", Mock(side_effect=KeyboardInterrupt))
        writer.close()
    writer.close()
    with pytest.raises(KeyboardInterrupt):
        RecordingWriter(tmp_path / "other.rec", header(), Mock(items=Mock(side_effect=KeyboardInterrupt)))
    assert [path.name for path in tmp_path.iterdir()] == ["recording.rec"]


@pytest.mark.parametrize(("content", "message"), [
    (b"PK\x03\x04", "no recording; accepted: recording.rec of a run's folder"),
    (b"", "no recording"), (MAGIC, "ends before its header; record the run again")])
def test_what_is_no_recording_is_refused(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "recording.rec").write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        Recording(tmp_path / "recording.rec")


def test_a_recording_of_another_version_is_refused_with_its_commit(tmp_path: Path) -> None:
    write(tmp_path / "recording.rec", version=7, commit="abc1234").close()
    with pytest.raises(ConfigError, match=r"recording of version 7; accepted: 1; .*commit abc1234"):
        Recording(tmp_path / "recording.rec")


def test_a_damaged_recording_is_refused_by_its_place(opened: Callable[[Path], Recording], tmp_path: Path) -> None:
    write(tmp_path / "recording.rec").close()
    content = bytearray((tmp_path / "recording.rec").read_bytes())
    recording = opened(tmp_path / "recording.rec")
    for place, _ in (recording._scenes[-1], recording._grains[-1]):
        content[place] ^= 0xFF
    (tmp_path / "recording.rec").write_bytes(content)
    recording = opened(tmp_path / "recording.rec")
    for read in (recording.scene, recording.grains):
        with pytest.raises(ConfigError, match=r"^\S+: damaged: at byte [0-9]+: [^;]*; record the run again$"):
            read(FRAMES - 1)
        read(0)  # the others can be read


@pytest.mark.parametrize(("says_size", "kind", "block", "message"), [
    (True, SHAPE, bytes(10**7), "damaged: at byte"), (False, SHAPE, bytes(10**7), "damaged: at byte"),
    (True, WAYPOINTS, b"[" + 10**6 * b"{}," + b"{}]", "should have at most 200 items"),
    (True, WAYPOINTS, 200_000 * b" " + b"[]", "damaged: at byte"), (True, HEADER, 10**6 * b"[", "header is not JSON")])
def test_a_small_file_that_unpacks_to_more_than_any_scene_is_refused(says_size: bool, kind: bytes, block: bytes,
                                                                     message: str, tmp_path: Path) -> None:
    """Thirty blocks of 10 MB in some kilobytes: refused at the block that is too many, before it is unpacked."""
    write(tmp_path / "recording.rec").close()
    packed = zstandard.ZstdCompressor(write_content_size=says_size).compress(block)
    content = (tmp_path / "recording.rec").read_bytes() + 30 * (BLOCK.pack(kind, len(packed)) + packed)
    (tmp_path / "recording.rec").write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        Recording(tmp_path / "recording.rec")

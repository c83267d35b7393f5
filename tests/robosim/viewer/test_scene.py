"""Colours, charts and embedded pages of a recording."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from robosim.recordings.frames import GrainState, SceneState
from robosim.recordings.header import VERSION, BodyEntry, CurveEntry, RecordingHeader, RegionEntry
from robosim.recordings.reader import Recording
from robosim.recordings.writer import RecordingWriter
from robosim.viewer.charts import History, add_cursor, value_range
from robosim.viewer.grain_colours import ASLEEP, OUTSIDE, GrainColours
from robosim.viewer.scene_view import SceneView
from robosim.viewer.server import embed_html, start_server, stop_server

GRAINS = GrainState(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.4, 0, 0]]), np.array([0.0, 0.01, 3.0]),
                    np.array([0.0, 1e3, 1e6]), np.array([False, True, True]))


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    """Return five frames of a body that rises with three grains, one of them outside of its region."""
    entry = RegionEntry(name="bowl", body="bowl", position=(0.0, 0.0, 0.0), half=(0.2, 0.2, 0.2))
    header = RecordingHeader(
        version=VERSION, kind="scene", title="three grains", frame_rate=10.0, grains=3, grain_radius=0.01,
        colour=(0.9, 0.8, 0.7), lower=(-1, -1, -1), upper=(1, 1, 1), tool="bowl", regions=[entry],
        bodies=[BodyEntry(name="bowl", moves=True, position=(0, 0, 0), quaternion=(1, 0, 0, 0))],
        curves=[CurveEntry(name="height", unit="m", chart="height")])
    writer = RecordingWriter(tmp_path / "recording.rec", header, {})
    for k in range(5):
        writer.add(SceneState(0.1 * k, np.array([[0, 0, 0.05 * k, 1, 0, 0, 0]]), np.array([0, 0, 1.0 + k, 0, 0, 0]),
                              np.array([0.05 * k])), GRAINS)
    writer.close()
    with Recording(tmp_path / "recording.rec") as opened:
        yield opened


def test_colours_show_what_they_are_named_after() -> None:
    colours = GrainColours(3, (0.9, 0.8, 0.7))
    material = colours.colours(GRAINS, "material")
    awake = colours.colours(GRAINS, "awake")
    assert tuple(awake[0]) == ASLEEP and np.array_equal(awake[1:], material[1:])
    outside = colours.colours(GRAINS, "outside", np.array([True, True, False]))
    assert tuple(outside[2]) == OUTSIDE and np.array_equal(outside[:2], material[:2])
    for name in ("speed", "pressure"):
        shown = colours.colours(GRAINS, name).astype(int).sum(axis=1)
        assert shown[0] < shown[1] < shown[2]


def test_a_history_has_what_the_frames_have(recording: Recording) -> None:
    history = History(recording)
    assert history.refresh() and not history.refresh()
    assert np.allclose(history.times, np.arange(5) / 10) and np.allclose(history.values[:, 0], 0.05 * np.arange(5))
    assert np.allclose(history.tool_positions[:, 2], 0.05 * np.arange(5)) and history.largest_force == pytest.approx(5)
    assert [history.nearest(t) for t in (-1.0, 0.0, 0.04, 0.06, 0.2, 9.0)] == [0, 0, 0, 1, 2, 4]


def test_a_cursor_is_a_vertical_line_and_leaves_the_curves() -> None:
    times, rows = np.arange(5.0), np.array([[1.0, 2.0, np.nan, 4.0, 5.0]])
    low, high = value_range(rows)
    assert low < 1.0 < 5.0 < high
    for near in range(5):
        x, curve, cursor = add_cursor(times, rows, near, low, high)
        shown = np.isfinite(cursor)
        assert shown.sum() == 2 and np.all(x[shown] == near) and set(cursor[shown]) == {low, high}
        assert np.array_equal(np.unique(x), times)
        drawn, gap = curve[np.searchsorted(x, times)], np.isnan(rows[0])
        assert np.array_equal(drawn[~gap], rows[0][~gap]) and np.all(drawn[gap] < low - (high - low))


def test_a_scene_shows_each_frame(recording: Recording) -> None:
    server = start_server()
    try:
        history = History(recording)
        history.refresh()
        view = SceneView(server, recording, history)
        for name in view.overlays.visible:
            view.overlays.set_visible(name, True)
        for k in (0, 4, 2):
            view.show(k)
            assert np.allclose(view._bodies["bowl"].position, [0, 0, 0.05 * k], atol=1e-6)
            assert np.abs(view._grains.points + view._centre - GRAINS.positions).max() < 1e-3  # type: ignore[union-attr]
            region, lines = view.overlays._regions[0]
            assert np.allclose(lines.position, [0, 0, 0.05 * k], atol=1e-6) and region.name == "bowl"
        (begin, end), = view.overlays._drawn["force"].points
        assert np.allclose(end - begin, [0, 0, 0.2 * 3 / 5], atol=1e-5)
        view.recolour("outside")
        assert tuple(view._grains.colors[2]) == OUTSIDE  # type: ignore[union-attr]
    finally:
        stop_server(server)


def test_a_page_holds_the_recording_and_asks_for_nothing_else(recording: Recording) -> None:
    page = embed_html(recording)
    assert "__VISER_EMBED_DATA__" in page and len(page) > 200_000
    assert "<script src=" not in page and "<link rel=\"stylesheet\" href=\"http" not in page

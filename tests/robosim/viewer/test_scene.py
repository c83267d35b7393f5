"""Scenes in a browser: what is drawn of a recording, and which grains a camera sees."""

import json
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from robosim.recordings.frames import GrainState, SceneState
from robosim.recordings.header import VERSION, BodyEntry, CurveEntry, RecordingHeader, RegionEntry
from robosim.recordings.reader import Recording
from robosim.recordings.writer import RecordingWriter
from robosim.rehearsal.browser.view import read_page_charts
from robosim.reports.curves import MOST_POINTS, Chart, Curve, pack_charts
from robosim.viewer.charts import History, add_cursor, sample, value_range
from robosim.viewer.overlays import join_labels
from robosim.viewer.playback import Playback, make_bookmark
from robosim.viewer.scene_view import ASLEEP, OUTSIDE, GrainColours, SceneView, Sight, find_in_sight, find_limits
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
    for name, limits in (("speed", (1e-3, 10.0)), ("pressure", (1.0, 1e6))):
        shown = colours.colours(GRAINS, name, limits=limits).astype(int).sum(axis=1)
        assert shown[0] < shown[1] < shown[2]


def test_colours_reach_over_what_the_recording_has(recording: Recording) -> None:
    """Whole decades, up to the largest values."""
    assert find_limits(recording, "speed") == pytest.approx((0.01, 10.0))
    assert find_limits(recording, "pressure") == pytest.approx((1e3, 1e6))


def test_names_that_would_cover_each_other_share_a_label() -> None:
    points = [("dig", 0.0), ("lift", 0.02), ("above", 0.3), ("pour", 0.31), ("away", 0.5)]
    labels = join_labels([(name, np.array([0.0, 0.0, height])) for name, height in points])
    assert [name for name, _ in labels] == ["dig, lift", "above, pour", "away"]
    assert all(place[2] == dict(points)[name.split(",")[0]] for name, place in labels)


def test_a_bookmark_opens_at_its_time(recording: Recording) -> None:
    """The page asks for it with its address; what is no time changes nothing."""
    server = start_server()
    try:
        playback = Playback(server, recording)
        camera = SimpleNamespace(position=(1.0, 2.0, 0.5), look_at=(0.0, 0.0, 0.1), fov=0.7)
        link = make_bookmark(0.3, camera)
        assert "initialCameraPosition=1.0000,2.0000,0.5000&initialCameraLookAt=0.0000,0.0000,0.1000&" in link
        for target, time in ((link, 0.3), ("?time=nan", 0.3), ("?time=x", 0.3), ("?time=99", 0.4), ("", 0.4)):
            with urllib.request.urlopen(f"http://127.0.0.1:{server.get_port()}/{target}", timeout=10) as page:
                assert page.status == 200
            playback.advance(0.0)
            assert playback._now == pytest.approx(time)
    finally:
        stop_server(server)


def test_a_history_has_what_the_frames_have(recording: Recording) -> None:
    history = History(recording)
    assert history.refresh() and not history.refresh()
    assert np.allclose(history.times, np.arange(5) / 10) and np.allclose(history.values[:, 0], 0.05 * np.arange(5))
    assert np.allclose(history.tool_positions[:, 2], 0.05 * np.arange(5)) and history.largest_force == pytest.approx(5)
    assert [history.nearest(t) for t in (-1.0, 0.0, 0.04, 0.06, 0.2, 9.0)] == [0, 0, 0, 1, 2, 4]


def test_charts_of_a_page_are_drawn_at_the_times_of_the_frames(recording: Recording, tmp_path: Path) -> None:
    """Curves of other times, one with a gap, through the file of a run; beside them what is accepted."""
    times = np.linspace(0.0, 0.4, 4001)
    values = np.where(times < 0.25, 100.0 * times, np.nan)
    charts = [Chart("mass [g]", [Curve("in the tool", times, values)], most=50.0),
              Chart("ratio [1]", [Curve("linear", times, 10.0 ** (-10 * times))], is_logarithmic=True)]
    (tmp_path / "curves.json").write_text(json.dumps(pack_charts(charts)))
    read = read_page_charts(tmp_path)
    assert [chart.title for chart in read] == ["mass [g]", "ratio [1]"] and len(read[0].curves[0].times) <= MOST_POINTS
    history = History(recording)
    history.refresh()
    mass, accepted = sample(read[0], history.times)
    assert mass[:3] == pytest.approx([0, 10, 20], abs=0.1) and np.isnan(mass[3:]).all() and np.all(accepted == 50.0)
    assert sample(read[1], history.times)[0] == pytest.approx(-10 * history.times, abs=0.01)
    server = start_server()
    try:
        playback = Playback(server, recording, read)
        playback.seek(0.2)
        assert [handle.title for handle in playback.charts._handles] == ["mass [g]", "logarithm of the ratio [1]"]
        assert playback.charts._handles[0].data[1][2] == pytest.approx(20, abs=0.1)
    finally:
        stop_server(server)


def test_a_damaged_file_of_curves_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert read_page_charts(tmp_path) == [] and capsys.readouterr().err == ""
    curve = '{"name": "a", "times": [0, 1], "values": [0], "dashed": false}'
    uneven = f'[{{"title": "a", "most": null, "least": null, "is_logarithmic": false, "curves": [{curve}]}}]'
    for text in ("[{]", '[{"title": 1}]', "{}", uneven):
        (tmp_path / "curves.json").write_text(text)
        assert read_page_charts(tmp_path) == []
        assert "shown are the curves of the recording" in capsys.readouterr().err


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


RADIUS = 0.004
SPACING = RADIUS / 0.62


def make_sight(eye: np.ndarray, target: np.ndarray) -> Sight:
    """Return a camera that looks from a place to another [m]."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Sight(eye, np.column_stack([right, np.cross(ahead, right), ahead]), 0.5, 0.8)


def make_bed() -> np.ndarray:
    """Return a bed of grains at the usual spacing, a little in disorder (n, 3) [m]."""
    axes = [np.arange(-0.1, 0.1, SPACING), np.arange(-0.1, 0.1, SPACING), np.arange(0.0, 0.06, SPACING)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return grid + np.random.default_rng(0).uniform(-0.2, 0.2, grid.shape) * SPACING


@pytest.mark.parametrize("eye", [(0.6, 0.1, 0.5), (0.0, 0.02, 0.9), (-0.7, -0.4, 0.03), (0.3, 0.3, 0.9)])
def test_no_grain_is_missed_that_nothing_hides(eye: tuple[float, float, float]) -> None:
    """Reference: a grain whose line of sight passes every other one at two radii or more is seen."""
    bed, sight = make_bed(), make_sight(np.array(eye), np.array([0.0, 0.0, 0.03]))
    seen = find_in_sight(bed, sight, RADIUS)
    to_eye = sight.eye - bed
    distance = np.linalg.norm(to_eye, axis=1, keepdims=True)
    direction = to_eye / distance
    for k in np.random.default_rng(1).choice(len(bed), 300, replace=False):
        offset = bed - bed[k]
        along = offset @ direction[k]
        apart = np.linalg.norm(offset - along[:, None] * direction[k], axis=1)
        if not ((along > 0.1 * RADIUS) & (apart < 2.0 * RADIUS)).any():
            assert seen[k]
    assert 0.02 < seen.mean() < 0.6


def test_what_is_behind_the_camera_or_beside_the_picture_is_left_out() -> None:
    sight = make_sight(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    places = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 0.3]])
    assert find_in_sight(places, sight, RADIUS).tolist() == [True, False, False, True]
    assert not find_in_sight(places[1:2], sight, RADIUS).any()


def test_a_camera_that_turned_or_moved_sees_others() -> None:
    sight = make_sight(np.array([1.0, 0.0, 0.5]), np.zeros(3))
    assert sight.has_moved(None, 1.0) and not sight.has_moved(sight, 1.0)
    assert not make_sight(np.array([1.0, 0.005, 0.5]), np.array([0.0, 0.005, 0.0])).has_moved(sight, 1.0)
    assert sight._replace(half_width=2.0 * sight.half_width).has_moved(sight, 1.0)
    assert make_sight(np.array([1.0, 0.1, 0.5]), np.array([0.0, 0.1, 0.0])).has_moved(sight, 1.0)
    assert make_sight(np.array([1.0, 0.0, 0.5]), np.array([0.0, 0.1, 0.0])).has_moved(sight, 1.0)

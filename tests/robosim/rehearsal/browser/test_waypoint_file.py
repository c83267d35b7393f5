"""Waypoints that are dragged come back from the file where they were dropped, and all else in the file stays."""

import re
from pathlib import Path

import numpy as np
import pytest

from robosim.base.errors import ConfigError
from robosim.base.resources import config_path
from robosim.config.rehearsal import load_rehearsal
from robosim.recordings.reader import FILE
from robosim.rehearsal.browser.view import begin_run
from robosim.rehearsal.browser.waypoint_file import WaypointFile, move_waypoint


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Return a copy of the spoon rehearsal, as a user's own file with comments."""
    path = tmp_path / "lab.yaml"
    path.write_text(config_path("rehearsals", "spoon", "rehearsal").read_text() + "# the end\n")
    return path


def test_a_waypoint_is_where_it_was_dropped_in_any_frame(own: Path) -> None:
    file, place = WaypointFile(str(own), []), np.array([0.70, -0.15, 0.2])
    before = own.read_text()
    for name in ("dig", "across"):  # frames of the two containers
        file.save(move_waypoint(file.config, name, place), [name])
        config = load_rehearsal(str(own))
        moved = next(w for w in config.waypoints if w.name == name)
        assert np.abs(config.tool_pose(moved).position - place).max() <= 1.5e-4
        others = [w for w in config.waypoints if w.name not in ("dig", "across")]
        assert others == [w for w in load_rehearsal("spoon").waypoints if w.name not in ("dig", "across")]
    kept = [line for line in before.splitlines() if line.startswith("#")]
    assert len(kept) > 3 and [line for line in own.read_text().splitlines() if line.startswith("#")] == kept
    changed = set(before.splitlines()) ^ set(own.read_text().splitlines())
    assert {re.sub(r"[-\d. \[\],]", "", line)[:22] for line in changed} <= {
        re.sub(r"[-\d. \[\],]", "", line)[:22] for line in before.splitlines() if "dig" in line or "across" in line}


def test_a_bundled_rehearsal_is_saved_as_a_file_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    bundled = config_path("rehearsals", "shovel", "rehearsal")
    content, file = bundled.read_text(), WaypointFile("shovel", [])
    target = file.save(move_waypoint(file.config, "up", np.array([0.6, 0.2, 0.3])), ["up"])
    assert target == tmp_path / "shovel.yaml" and bundled.read_text() == content
    with pytest.raises(ConfigError, match=r"shovel.yaml: exists; accepted: `robosim view shovel.yaml --plan`"):
        WaypointFile("shovel", []).save(file.config, ["up"])


def test_a_waypoint_that_the_file_lost_is_refused(own: Path) -> None:
    file = WaypointFile(str(own), [])
    own.write_text(own.read_text().replace("name: dig", "name: scoop"))
    content = own.read_text()
    with pytest.raises(ConfigError, match=r"has no waypoint 'dig' any more; accepted: start, above"):
        file.save(file.config, ["dig"])
    assert own.read_text() == content


def test_a_file_that_would_not_be_read_again_is_not_written(own: Path) -> None:
    file, content = WaypointFile(str(own), []), own.read_text()
    with pytest.raises(ConfigError, match=r"lab.yaml: waypoints.*nan"):
        file.save(move_waypoint(file.config, "dig", np.array([0.7, np.nan, 0.2])), ["dig"])
    assert own.read_text() == content and list(own.parent.iterdir()) == [own]


@pytest.mark.parametrize("name", [FILE, f"{FILE}.part", "2-SpoonTranslate.rec", "1-Spoon.rec.part"])
def test_a_run_in_a_viewer_keeps_the_recording_of_another(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"of an hour")
    with pytest.raises(ConfigError, match=rf"holds {name} of another run"), begin_run("spoon", None, tmp_path, []):
        pass
    assert (tmp_path / name).read_bytes() == b"of an hour"

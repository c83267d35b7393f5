"""A rehearsal that tests share, and its results."""

import os
from pathlib import Path

import pytest
import yaml
from bundled import read_bundled

from robosim.episode.film import FilmStyle
from robosim.rehearsal.session import RunOptions, rehearse


def write_short(path: Path) -> Path:
    """Write a rehearsal of three waypoints with cells of 10 mm, which exercises all parts in little time."""
    data = read_bundled("rehearsals", "spoon")
    by_name = {w["name"]: w for w in data["waypoints"]}
    for name in ("start", "home"):
        by_name[name]["position"][2] = 0.12
    dip = by_name["above"] | {"name": "dip", "position": [-0.03, 0, 0.06], "speed": 0.3, "stop": True, "dwell": 0.2}
    data["waypoints"] = [by_name["start"], dip, by_name["home"]]
    data.update(weigh_at="dip", tool_wall=0.005, grasp_time=0.2)
    data["field"] |= {"cell": 0.01, "grains_per_cell": 4}
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """Return the short rehearsal as a test's own file."""
    return write_short(tmp_path / "short.yaml")


@pytest.fixture(scope="session")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results of the short rehearsal, filmed where that is possible; its file is beside the folder."""
    folder = tmp_path_factory.mktemp("short")
    film = FilmStyle() if os.environ["MUJOCO_GL"] != "disable" else None
    status = rehearse(str(write_short(folder / "short.yaml")), folder / "out", RunOptions(film), force_export=True)
    assert status == 1, "it is too short to deliver anything"
    return folder / "out"

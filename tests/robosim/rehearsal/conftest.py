"""A rehearsal that tests share, and its results."""

import os
from pathlib import Path

import pytest
from bundled import write_short

from robosim.episode.film import FilmStyle
from robosim.rehearsal.session import RunOptions, rehearse


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

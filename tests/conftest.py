"""One backend for the whole suite: double precision is asked for per solver. One folder of settled starts, too."""

import os
from collections.abc import Iterator

import pytest
from browser_window import BrowserWindow

import mpm
from robosim.rendering.opengl import choose_graphics

choose_graphics()

mpm.init(arch="cpu", precision="f32", threads=1)


@pytest.fixture(scope="session", autouse=True)
def starts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Settled starts and distances of meshes are made once in a run of the suite, and not the user's."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROBOSIM_CACHE", str(base / "starts"))
        patch.setenv("MPM_CACHE", str(base / "distances"))
        yield


@pytest.fixture
def browser() -> Iterator[BrowserWindow]:
    """Return a browser's window; skips where there is none."""
    window = BrowserWindow()
    yield window
    window.close()

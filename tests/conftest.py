"""One backend for the whole suite: double precision is asked for per solver. One folder of caches, too.

Compiled kernels, settled starts and distances of meshes are kept in .cache of the checkout, so that a second run needs
none of them again; each is found by a digest of what it depends on."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser_window import BrowserWindow

import mpm
from robosim.rendering.opengl import choose_graphics

CACHE = Path(__file__).resolve().parents[1] / ".cache"
os.environ.setdefault("TI_OFFLINE_CACHE_FILE_PATH", str(CACHE / "kernels"))
os.environ["ROBOSIM_CACHE"], os.environ["MPM_CACHE"] = str(CACHE / "starts"), str(CACHE / "distances")
os.environ["XDG_DATA_HOME"] = str(CACHE / "data")
choose_graphics()

mpm.init(arch="cpu", precision="f32", threads=1)


@pytest.fixture
def browser() -> Iterator[BrowserWindow]:
    """Return a browser's window; skips where there is none."""
    window = BrowserWindow()
    yield window
    window.close()

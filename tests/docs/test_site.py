"""The site of the documentation: built without a warning, opened from disk without a request to any network."""

import subprocess
import sys
from pathlib import Path

import pytest
from browser_window import BrowserWindow, wait_until
from generators import catalogue

from robosim.randomization.ranges import NUMBERS

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"
PAGES = ("index.html", "start/index.html", "concepts/field.html", "results/verification.html", "reference/keys.html")


def test_tables_hold_every_material_and_every_number_that_is_drawn() -> None:
    """Those that need no Sphinx; sugar's 5e-4 is text to YAML, and a mass to dose has no range in `wide`."""
    ranges = catalogue.randomization()
    assert "m] | 0.0005 |" in catalogue.materials() and all(f"`{name}`" in ranges for name in NUMBERS)


@pytest.mark.slow
def test_pages_need_no_network(browser: BrowserWindow, tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    subprocess.run([sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", str(DOCS), str(tmp_path)], check=True)
    for name in PAGES:
        browser.open(tmp_path / name)
        wait_until(lambda: browser.has("//h1"), 30.0)
        assert not browser.faults(), name

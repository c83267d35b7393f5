"""The site of the documentation opens from disk: no request to any network, no error in the console."""

import subprocess
import sys
from pathlib import Path

import pytest
from browser_window import BrowserWindow, wait_until

pytestmark = pytest.mark.slow
DOCS = Path(__file__).resolve().parent.parent.parent / "docs"
PAGES = ("index.html", "start/index.html", "concepts/field.html", "results/verification.html", "reference/keys.html")


def test_pages_need_no_network(browser: BrowserWindow, tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    subprocess.run([sys.executable, "-m", "sphinx", "-q", "-b", "html", str(DOCS), str(tmp_path)], check=True)
    for name in PAGES:
        browser.open(tmp_path / name)
        wait_until(lambda: browser.has("//h1"), 30.0)
        assert not browser.faults(), name

"""Pages of reports in a browser."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from robosim.reports.page import Page


@pytest.mark.slow
def test_a_click_on_a_column_sorts_the_table(tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("needs chromium")
    page = Page("sorts")
    page.add_table(["n"], [[3.0], [1.0], [2.0]])
    path = tmp_path / "index.html"
    path.write_text(page.html().replace("</script>", ';document.querySelector("th").click();</script>'))
    dom = subprocess.run([browser, "--headless", "--no-sandbox", "--dump-dom", path.as_uri()], capture_output=True,
                         text=True, timeout=60, check=True).stdout
    assert re.findall(r'data-value="([0-9.]+)"', dom) == ["1.0", "2.0", "3.0"]

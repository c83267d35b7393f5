"""Pages of reports in a browser."""

import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from robosim.reports.curves import MOST_POINTS, Chart, Curve, thin_out
from robosim.reports.page import Page
from robosim.reports.plot import draw_charts


@pytest.mark.slow
def test_a_click_on_a_column_sorts_the_table(tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("needs chromium")
    page = Page("sorts")
    page.add_table(["n"], [[3.0], [1.0], [2.0]])
    path = tmp_path / "index.html"
    path.write_text(page.html().replace("</body>", '<script>document.querySelector("th").click()</script></body>'))
    dom = subprocess.run([browser, "--headless", "--no-sandbox", "--dump-dom", path.as_uri()], capture_output=True,
                         text=True, timeout=60, check=True).stdout
    assert re.findall(r'data-value="([0-9.]+)"', dom) == ["1.0", "2.0", "3.0"]


class Parts(HTMLParser):
    """What a page refers to, and its texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep references."""
        self.references += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        """Keep texts."""
        self.texts.append(data)


def test_a_page_needs_nothing_but_itself_and_escapes_what_it_shows() -> None:
    page = Page("<title> & co", {"command": "robosim <x>"})
    page.set_verdict("<b>1 of 2</b> missed", holds=False)
    page.add_heading("A & B")
    page.add_film(b"film")
    page.add_picture(b"picture")
    page.add_scene("<p>a document</p>", "scene")
    page.add_details("more", "<pre>")
    page.add_table(["<i>"], [["<td>", 1.5, None, "missed"]])
    page.add_table(["no-rows-here"], [])
    load = Curve("load", np.arange(3.0), np.arange(3.0))
    page.add_plot(draw_charts([Chart("mass [g]", [load], most=2.0)], {"up": 1}))
    html = page.html()
    parts = Parts(html)
    assert all(reference.startswith("data:") for reference in parts.references) and len(parts.references) == 2
    texts = " ".join(parts.texts)
    assert all(text in texts for text in ("<title> & co", "<b>1 of 2</b> missed", "<td>"))
    assert "no-rows-here" not in texts
    assert 'class="verdict fail"' in html and 'class="missed">missed' in html


def test_thinned_curves_keep_their_extremes_and_gaps() -> None:
    times = np.linspace(0.0, 10.0, 50_001)
    values = np.sin(7.0 * times)
    values[20_000], values[40_000:41_000] = 5.0, np.nan
    kept_times, kept = thin_out(times, values)
    assert len(kept) <= MOST_POINTS and np.nanmax(kept) == 5.0 and kept_times[np.nanargmax(kept)] == times[20_000]
    assert np.isnan(kept).sum() >= 12 and np.nanmin(kept) == np.nanmin(values)
    assert all(value == values[np.searchsorted(times, t)] or np.isnan(value) for t, value in zip(kept_times, kept))
    assert np.array_equal(thin_out(times[:10], values[:10])[1], values[:10])

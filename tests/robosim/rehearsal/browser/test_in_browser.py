"""A plan and a run's page in a real browser: a waypoint is dragged and saved, and the page asks for nothing else."""

import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser_window import BrowserWindow, serve, wait_until

from robosim.config.rehearsal import load_rehearsal
from robosim.episode.film import FilmStyle
from robosim.rehearsal.session import RunOptions, rehearse

pytestmark = pytest.mark.slow
EYE, TARGET, FOV_DEG = np.array([1.95, -1.15, 0.95]), np.array([0.42, -0.02, 0.34]), 33.0
"""The camera `overview` of models/workcell/workcell.xml, at which a plan begins."""


def project(place: np.ndarray, width: float, height: float) -> tuple[float, float]:
    """Return where a place [m] is in a picture [pixels]."""
    ahead = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y, depth = np.column_stack([right, np.cross(ahead, right), ahead]).T @ (place - EYE)
    scale = 0.5 * height / np.tan(np.radians(FOV_DEG) / 2.0)
    return float(width / 2 + scale * x / depth), float(height / 2 + scale * y / depth)


def test_a_waypoint_is_dragged_and_saved(browser: BrowserWindow, short: Path) -> None:
    config = load_rehearsal(str(short))
    before = {w["name"]: w["position"] for w in yaml.safe_load(short.read_text())["waypoints"]}
    browser.driver.set_window_size(1700, 1000)  # the controls cover no waypoint
    with serve(str(short), "--plan", folder=short.parent) as address:
        browser.open(address)
        wait_until(lambda: browser.has("//button[normalize-space()='save to the file']"), 60.0)
        wait_until(lambda: browser.picture()[300:700, 500:1200].std() > 8.0, 30.0)
        time.sleep(2.0)
        assert browser.has("//*[contains(text(), 'dragged: none')]")
        canvas = browser.find("//canvas").rect
        dip = config.tool_pose(config.waypoints[1]).position
        ends = [project(dip + [0.0, 0.0, up], canvas["width"], canvas["height"]) for up in (0.04, 0.09)]
        browser.drag(*((canvas["x"] + x, canvas["y"] + y) for x, y in ends))
        wait_until(lambda: browser.has("//*[contains(text(), 'dragged: dip')]"), 60.0)
        browser.click(browser.button("save to the file"))
        wait_until(lambda: yaml.safe_load(short.read_text())["waypoints"][1]["position"] != before["dip"], 60.0)
        assert not browser.faults()
    after = {w["name"]: w["position"] for w in yaml.safe_load(short.read_text())["waypoints"]}
    moved = np.array(after.pop("dip")) - before.pop("dip")
    assert after == before and 0.02 < moved[2] < 0.12 and np.abs(moved[:2]).max() < 1e-3
    load_rehearsal(str(short))


def test_the_page_of_a_run_needs_no_network(browser: BrowserWindow, short: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    rehearse(str(short), out, RunOptions(FilmStyle(), 5))
    browser.open(out / "index.html")
    wait_until(lambda: browser.has("//div[contains(@class, 'plotly-graph-div')]//*[name()='svg']"), 60.0)
    assert browser.has("//p[contains(@class, 'verdict')]") and browser.has("//video")
    browser.click(browser.button("open in 3-D"))
    frame = browser.find("//figure[@class='scene']//iframe")
    browser.driver.execute_script("arguments[0].scrollIntoView()", frame)
    wait_until(lambda: browser.picture().std() > 8.0, 60.0)
    time.sleep(3.0)
    assert (out / "index.html").stat().st_size < 25_000_000
    assert not browser.faults()

"""A real browser for tests: Debian's Chromium, driven by Selenium, without a display."""

import io
import json
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

INSTALL = "apt install chromium chromium-driver, pip install selenium"
FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1100,750",
         "--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist", "--allow-file-access-from-files")


class BrowserWindow:
    """A window that records its requests and its console."""

    def __init__(self) -> None:
        pytest.importorskip("selenium", reason=INSTALL)
        if shutil.which("chromedriver") is None or shutil.which("chromium") is None:
            pytest.skip(INSTALL)
        from selenium import webdriver

        options = webdriver.ChromeOptions()
        for flag in FLAGS:
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver: Any = webdriver.Chrome(options=options,
                                            service=webdriver.ChromeService(shutil.which("chromedriver")))
        self.driver.set_page_load_timeout(120)

    def open(self, address: str | Path) -> None:
        self.driver.get(address.resolve().as_uri() if isinstance(address, Path) else address)

    def find(self, xpath: str) -> Any:
        return self.driver.find_element("xpath", xpath)

    def has(self, xpath: str) -> bool:
        return bool(self.driver.find_elements("xpath", xpath))

    def input(self, label: str) -> Any:
        return self.find(f"//label[normalize-space()='{label}']/following::input[1]")

    def checkbox(self, label: str) -> Any:
        return self.find(f"//label[normalize-space()='{label}']/following::input[@type='checkbox'][1]")

    def button(self, label: str) -> Any:
        return self.find(f"//button[normalize-space()='{label}']")

    def click(self, element: Any) -> None:
        """Click an element, also one that another covers."""
        self.driver.execute_script("arguments[0].click()", element)

    def drag(self, begin: tuple[float, float], end: tuple[float, float], steps: int = 12) -> None:
        """Move the pointer with its button pressed between two places of the window [pixels]."""
        from selenium.webdriver.common.action_chains import ActionBuilder

        actions = ActionBuilder(self.driver, duration=60)
        pointer = actions.pointer_action
        pointer.move_to_location(*map(int, begin))
        pointer.pause(0.3)
        pointer.pointer_down()
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            x, y = (a + share * (b - a) for a, b in zip(begin, end))
            pointer.move_to_location(int(x), int(y))
        pointer.pause(0.2)
        pointer.pointer_up()
        actions.perform()

    def picture(self) -> np.ndarray:
        """Return what the window shows (height, width, 3)."""
        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(self.driver.get_screenshot_as_png())).convert("RGB")).astype(int)

    def faults(self) -> list[str]:
        """Return the errors of the console, and the requests to other machines."""
        errors = [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                url = message["params"]["request"]["url"]
                if not url.startswith(("data:", "blob:", "file:", "http://127.0.0.1", "chrome", "about:")):
                    errors.append(url)
        return errors

    def close(self) -> None:
        self.driver.quit()


def wait_until(holds: Callable[[], bool], limit: float) -> float:
    """Wait until something holds and return how long it took [s]; fails after the limit."""
    began = time.monotonic()
    while not holds():
        assert time.monotonic() - began < limit, "not in time"
        time.sleep(0.1)
    return time.monotonic() - began


@contextmanager
def serve(*words: str, folder: Path | None = None) -> Iterator[str]:
    """Run `robosim view` with these words in a folder; give the address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen([sys.executable, "-m", "robosim", "view", *words, "--port", str(port)],
                               stdout=subprocess.PIPE, text=True, cwd=folder)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().split()[0]
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()

"""A scene that a program steps is shown while it runs, and its recording stays."""

import socket
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from trays import tray

from robosim.base.errors import ConfigError
from robosim.recordings.reader import Recording

SCENE = """<mujoco><option timestep="0.002"/><worldbody><body name="ball" pos="0.05 0.05 0.08"><freejoint/>
  <geom size="0.012" density="3000"/></body></worldbody></mujoco>"""


def free_port() -> int:
    """Return a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.slow
def test_a_scene_is_shown_while_it_runs_and_its_recording_stays(tmp_path: Path) -> None:
    plugin = tray(SCENE, (0.1, 0.1, 0.04), bodies={"ball": None})
    with plugin.view(port=free_port(), out=tmp_path / "ball.rec") as view:
        for _ in range(100):
            plugin.step()
            view.update()
        for _ in range(200):
            try:
                with urllib.request.urlopen(view.address, timeout=5) as page:
                    assert page.status == 200
                break
            except urllib.error.URLError:
                time.sleep(0.1)
        else:
            pytest.fail("no page within 20 s")
    with Recording(tmp_path / "ball.rec") as recording:
        assert recording.header.tool == "ball" and len(recording) == 5  # 0.2 s at 20 frames a second, and the start
        heights = [recording.scene(k).poses[0, 2] for k in range(5)]
        assert heights[0] == pytest.approx(0.08, abs=1e-6) and heights[-1] < 0.05
        assert max(np.diff(heights)) < 1e-4  # it falls, and may spring back by so much
        assert recording.scene(4).wrench[2] > 0.1  # the sand carries the ball
    view.close()


def test_a_port_in_use_is_refused_before_anything_is_recorded(tmp_path: Path) -> None:
    plugin = tray(SCENE, (0.1, 0.1, 0.04), bodies={"ball": None})
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(ConfigError, match="Address already in use"):
            plugin.view(port=other.getsockname()[1], out=tmp_path / "ball.rec")
    assert not list(tmp_path.iterdir())

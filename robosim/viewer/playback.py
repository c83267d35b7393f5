"""The controls of the viewer: time, speed, cameras, colours and overlays."""

import time as clock
from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from robosim.recordings.header import CameraEntry
from robosim.recordings.reader import Recording
from robosim.reports.curves import Chart
from robosim.viewer.charts import Charts, History
from robosim.viewer.overlays import OVERLAYS
from robosim.viewer.scene_view import COLOURINGS, SceneView, aim_first_camera
from robosim.viewer.server import take_asked_time

SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x", "5x")
PERIOD, REFRESH, CAMERA_PERIOD, CURSOR_PERIOD = 0.02, 0.5, 0.1, 0.4
"""Times [s] after which the clock is read again, the file of a run that goes on, and the page's camera while nothing
plays; and after which slider and cursor are moved while it plays: the browser lays out both anew each time."""


class Playback:
    """Plays a recording, and follows one that is still written. charts: of its run's page, none where it goes on."""

    def __init__(self, server: viser.ViserServer, recording: Recording, charts: Sequence[Chart] = ()) -> None:
        self.server, self.recording = server, recording
        self.history = History(recording)
        self.view = SceneView(server, recording, self.history)
        self.charts = Charts(server, recording.header.curves, self.history, charts)
        self._is_following, self._cursor_moved, self._refreshed, self._looked = not recording.is_finished, 0.0, 0.0, 0.0
        self._is_setting = False
        self._add_controls()
        aim_first_camera(server, recording.header.cameras, "overview")
        self._now = 0.0
        self.refresh()
        self.seek(np.inf if self._is_following else 0.0)

    def refresh(self) -> None:
        """Take over frames that were added to the file."""
        self.recording.refresh()
        times = self.history.times
        if self.history.refresh():
            times = self.history.times
            self.charts.refresh()
            self._slider.max = max(float(times[-1]), float(times[0]) + 1e-3)
        state = "" if self.recording.is_finished else " (goes on)"
        self._state.content = f"{len(times)} frames, {times[-1] if len(times) else 0.0:.2f} s{state}"

    def seek(self, time: float) -> None:
        """Show the frame at a time [s]."""
        times = self.history.times
        if not len(times):
            return
        self._now = float(np.clip(time, times[0], times[-1]))
        k = self.history.nearest(self._now)
        if k != self.view.frame:
            self.view.show(k)
        if clock.monotonic() - self._cursor_moved > CURSOR_PERIOD or not self._play.value:
            self._is_setting = True
            self._slider.value = self._now
            self._is_setting = False
            self.charts.show(self._now)
            self._cursor_moved = clock.monotonic()

    def run(self) -> None:
        """Play until interrupted."""
        last = clock.monotonic()
        while True:
            clock.sleep(PERIOD)
            now = clock.monotonic()
            self.advance(now - last)
            last = now

    def advance(self, elapsed: float) -> None:
        """Go on by some time [s] of the clock."""
        if not self.recording.is_finished and clock.monotonic() - self._refreshed > REFRESH:
            self._refreshed = clock.monotonic()
            self.refresh()
            if self._is_following and len(self.history.times):
                self.seek(self.history.times[-1])
        asked = take_asked_time(self.server)
        if asked is not None and np.isfinite(asked):
            self._is_following, self._play.value = False, False
            self.seek(asked)
        times = self.history.times
        if not self._play.value and clock.monotonic() - self._looked > CAMERA_PERIOD:
            self._looked = clock.monotonic()
            self.view.follow_camera()
        if self._play.value and len(times):
            end = self._now >= times[-1] - 1e-9
            if end and not self._loop.value:
                self._play.value = False
                return
            self.seek(times[0] if end else self._now + elapsed * float(self._speed.value.rstrip("x")))

    def _add_controls(self) -> None:
        gui, header = self.server.gui, self.recording.header
        gui.set_panel_label(header.title or header.kind)
        self._state = gui.add_markdown("")
        self._slider = gui.add_slider("time [s]", min=0.0, max=1.0, step=1e-3, initial_value=0.0)
        self._play = gui.add_checkbox("play", initial_value=False)
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1x")
        self._loop = gui.add_checkbox("repeat", initial_value=True)
        self._colour = gui.add_dropdown("grains by", COLOURINGS, initial_value="material")
        self._legend = gui.add_markdown("")
        with gui.add_folder("show"):
            boxes = {name: gui.add_checkbox(name, initial_value=False) for name in OVERLAYS}
        with gui.add_folder("camera"):
            for camera in header.cameras:
                gui.add_button(camera.name).on_click(lambda event, camera=camera: self._aim(event.client, camera))
            gui.add_button("bookmark").on_click(lambda event: self._mark(event.client))
            self._bookmark = gui.add_markdown("")
        self._slider.on_update(self._scrub)
        self._colour.on_update(self._recolour)
        for name, box in boxes.items():
            box.on_update(lambda event, name=name: self._toggle(name, event.target.value))

    def _scrub(self, event: Any) -> None:
        if not self._is_setting and event.client is not None:
            self._is_following = False
            self.seek(event.target.value)

    def _recolour(self, event: Any) -> None:
        self.view.recolour(event.target.value)
        self._legend.content = self.view.legend

    def _toggle(self, name: str, visible: bool) -> None:
        self.view.overlays.set_visible(name, visible)
        if self.view.frame >= 0:
            self.view.show(self.view.frame)

    def _mark(self, client: viser.ClientHandle | None) -> None:
        """Give the link that opens the page at this time and with this camera."""
        if client is not None:
            link = make_bookmark(self._now, client.camera)
            self._bookmark.content = f"[{self._now:.2f} s, this camera]({link})"

    @staticmethod
    def _aim(client: viser.ClientHandle | None, camera: CameraEntry) -> None:
        if client is not None:
            client.camera.position, client.camera.look_at = np.array(camera.position), np.array(camera.target)
            client.camera.fov = np.radians(camera.fov_deg)


def make_bookmark(time: float, camera: Any) -> str:
    """Return the address of a view, relative to the page: a time [s], which the server reads, and a camera of viser's,
    which the page reads itself."""
    place, target = (",".join(f"{value:.4f}" for value in part) for part in (camera.position, camera.look_at))
    return f"?time={time:.3f}&initialCameraPosition={place}&initialCameraLookAt={target}&" \
           f"initialCameraFov={float(camera.fov):.4f}"

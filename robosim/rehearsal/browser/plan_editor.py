"""The planned motion of a rehearsal, without grains: waypoints can be dragged and saved back to the file."""

import tempfile
import time as clock
from pathlib import Path
from typing import Any

import numpy as np
import viser

from robosim.base.errors import RobosimError
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.settings import Setting
from robosim.recordings.reader import FILE, Recording
from robosim.rehearsal.browser.waypoint_file import WaypointFile, move_waypoint
from robosim.viewer.playback import PERIOD, Playback


class PlanEditor:
    """Plans a rehearsal's motion, shows it, and plans it again when waypoints were dragged.
    Raises ConfigError for a file that cannot be used; a motion that cannot be planned is explained on the page."""

    def __init__(self, name: str, settings: list[Setting]) -> None:
        self._file = WaypointFile(name, settings)
        self._folder = tempfile.TemporaryDirectory(prefix="robosim-plan-")
        self._changed: dict[str, np.ndarray] = {}
        """Waypoint -> its new world position (3,) [m]."""
        self._is_stale, self._playback, self._recording = True, None, None
        self._is_to_save, self._count = False, 0

    def run(self, server: viser.ViserServer) -> None:
        """Show and plan until interrupted."""
        last = clock.monotonic()
        while True:
            if self._is_to_save:
                self._is_to_save = False
                self._save(server)
            if self._is_stale:
                self._is_stale = False
                self._plan(server)
            clock.sleep(PERIOD)
            now = clock.monotonic()
            if self._playback is not None:
                self._playback.advance(now - last)
            last = now

    def _plan(self, server: viser.ViserServer) -> None:
        """Plan the motion with the waypoints as they are now, and show it."""
        from robosim.rehearsal.browser.plan_recording import record_plan

        config, message = self._config(), ""
        path = Path(self._folder.name) / f"{self._count}-{FILE}"
        self._count += 1
        server.gui.reset()
        server.scene.reset()
        note = server.gui.add_markdown("planning ...")
        try:
            record_plan(config, path)
        except RobosimError as error:
            message = f"**not possible:** {error}"
        note.remove()
        if message:  # what was possible before is shown on
            server.gui.add_markdown(message)
        else:
            if self._recording is not None:
                self._recording.close()
            self._recording = Recording(path)
        if self._recording is not None:
            self._playback = Playback(server, self._recording)
            self._playback.view.overlays.set_visible("path", True)
        self._add_handles(server, config)

    def _config(self) -> RehearsalConfig:
        config = self._file.config
        for name, position in self._changed.items():
            config = move_waypoint(config, name, position)
        return config

    def _add_handles(self, server: viser.ViserServer, config: RehearsalConfig) -> None:
        """Add a handle at each waypoint, a list of them, and buttons to save or to undo."""

        for waypoint in config.waypoints:
            pose = config.tool_pose(waypoint)
            handle = server.scene.add_transform_controls(f"/waypoints/{waypoint.name}", scale=0.06,
                                                         disable_rotations=True, position=pose.position,
                                                         disable_sliders=True)
            server.scene.add_label(f"/waypoints/{waypoint.name}/name", waypoint.name)
            handle.on_drag_end(lambda event, name=waypoint.name: self._drag(name, event))
        with server.gui.add_folder("waypoints"):
            changed = ", ".join(self._changed) or "none"
            server.gui.add_markdown(f"dragged: {changed}")
            server.gui.add_button("save to the file", disabled=not self._changed).on_click(lambda _: self._ask_save())
            server.gui.add_button("undo", disabled=not self._changed).on_click(lambda _: self._undo())

    def _drag(self, name: str, event: Any) -> None:
        self._changed[name] = np.array(event.target.position, float)
        self._is_stale = True

    def _undo(self) -> None:
        self._changed.clear()
        self._is_stale = True

    def _ask_save(self) -> None:
        self._is_to_save = True

    def _save(self, server: viser.ViserServer) -> None:
        """Write the dragged waypoints into the file, in which comments and order stay."""
        try:
            place = self._file.save(self._config(), list(self._changed))
        except (RobosimError, OSError) as error:
            server.gui.add_markdown(f"**not saved:** {error}")
            return
        self._changed.clear()
        self._is_stale = True
        print(f"saved to {place}", flush=True)

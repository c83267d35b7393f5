"""The film of a rehearsal: frames at a fixed rate, nine of them kept for a sheet."""

import itertools

import mujoco
import numpy as np

from robosim.config.materials import MaterialConfig
from robosim.config.output import OutputFolder
from robosim.config.rehearsal import RehearsalConfig
from robosim.errors import UnknownName
from robosim.rehearsal import CAMERAS
from robosim.rehearsal.rehearsal import Rehearsal
from robosim.rendering.renderer import GRAIN_RADIUS, SceneRenderer, add_grain_skin, add_mark, apply_quality
from robosim.rendering.video import Mp4Writer, contact_sheet
from robosim.scene.build import build_rehearsal_spec
from robosim.scene.models import compile_spec

FRAME_RATE = 30
SHEET_MOMENTS = 9


def check_camera(name: str) -> None:
    """Raise UnknownName unless the work cell has this camera."""
    if name not in CAMERAS:
        raise UnknownName("camera", name, CAMERAS)


class Film:
    """Draws the state of a rehearsal on a model of its own: the simulated one carries nothing for pictures."""

    def __init__(self, rehearsal: Rehearsal, out: OutputFolder, camera: str) -> None:
        check_camera(camera)
        self._rehearsal, self._out, self._camera = rehearsal, out, camera
        self._model = self._drawn_model(rehearsal.config, rehearsal.material)
        self._data = mujoco.MjData(self._model)
        self._renderer = SceneRenderer(self._model, len(rehearsal.solver.positions()))
        self._writer = Mp4Writer(out.path / "rehearsal.mp4", fps=FRAME_RATE)
        self._next_frame = 0.0
        self._moments = list(_moments(rehearsal))
        self._kept: list[np.ndarray] = []
        self._captions: list[str] = []

    def _drawn_model(self, config: RehearsalConfig, material: MaterialConfig) -> mujoco.MjModel:
        spec = build_rehearsal_spec(config)
        apply_quality(spec)
        if config.area is not None:
            add_mark(spec, config.area)
        radius = GRAIN_RADIUS * self._rehearsal.grains.grain_volume ** (1 / 3)
        add_grain_skin(spec, len(self._rehearsal.solver.positions()), radius, material.colour)
        return compile_spec(spec)

    def look(self) -> None:
        """Add a frame when its time has come."""
        time = self._rehearsal.time
        if time + 1e-9 < self._next_frame:
            return
        self._next_frame += 1.0 / FRAME_RATE
        frame = self.frame()
        self._writer.add(frame)
        if self._moments and time >= self._moments[0][0]:
            self._kept.append(frame)
            self._captions.append(f"{self._moments.pop(0)[1]}, {time:.1f} s")

    def frame(self) -> np.ndarray:
        """Picture (height, width, 3) of the present state."""
        self._data.qpos[:] = self._rehearsal.data.qpos
        return self._renderer.frame(self._data, self._rehearsal.solver.positions(), self._camera)

    def close(self) -> None:
        """Finish the film, also after a stop: what was drawn can be watched."""
        self._writer.close()
        if self._kept:
            self._out.write("frames.png", lambda path: contact_sheet(self._kept, self._captions, path))
        self._renderer.close()


def _moments(rehearsal: Rehearsal) -> list[tuple[float, str]]:
    """Nine waypoints with the times [s] at which they are passed: those that follow closest on another are left out.
    Of a learnt motion, nine moments."""
    if rehearsal.config.trajectory == "learned":
        marks = sorted((rehearsal.waypoint_time(name), name) for name in rehearsal.plan.path.times)
        moments = np.linspace(0.0, rehearsal.duration - 1.0 / FRAME_RATE, SHEET_MOMENTS)
        return [(float(t), next((name for at, name in reversed(marks) if at <= t), "start")) for t in moments]
    times = sorted((rehearsal.waypoint_time(name), name) for name in rehearsal.plan.path.times)
    while len(times) > SHEET_MOMENTS:
        gaps = [b[0] - a[0] for a, b in itertools.pairwise(times)]
        del times[int(np.argmin(gaps)) + 1]
    return times

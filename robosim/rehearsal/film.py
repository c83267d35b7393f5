"""The film of a rehearsal: frames at a fixed rate, and nine of them on a sheet."""

import itertools

import mujoco
import numpy as np

from robosim.config.output import OutputFolder
from robosim.errors import UnknownName
from robosim.rehearsal import CAMERAS
from robosim.rehearsal.run import RehearsalRun
from robosim.rendering.grain_skin import GRAIN_RADIUS, add_grain_skin
from robosim.rendering.renderer import SceneRenderer, add_mark, apply_quality
from robosim.rendering.video import Mp4Writer, write_contact_sheet
from robosim.scene.build import build_rehearsal_spec
from robosim.scene.models import compile_spec

FRAME_RATE = 30
"""Frames per second of simulated time."""
SHEET_FRAMES = 9
"""Frames on the sheet."""


def check_camera(name: str) -> None:
    """Raise UnknownName unless the work cell has this camera."""
    if name not in CAMERAS:
        raise UnknownName("camera", name, CAMERAS)


class Film:
    """A film of a rehearsal, drawn with a model of its own.

    The simulated model has no visual extras. Writes rehearsal.mp4 and frames.png into `out`. Raises UnknownName for the
    camera, RenderingUnavailable.
    """

    def __init__(self, run: RehearsalRun, out: OutputFolder, camera: str) -> None:
        check_camera(camera)
        self._run, self._out, self._camera = run, out, camera
        self._model = _compile_drawn_model(run)
        self._data = mujoco.MjData(self._model)
        self._renderer = SceneRenderer(self._model, len(run.solver.positions()))
        self._writer = Mp4Writer(out.path / "rehearsal.mp4", fps=FRAME_RATE)
        self._next_frame_time = 0.0
        self._sheet_moments = _choose_sheet_moments(run)
        self._sheet: list[np.ndarray] = []
        self._captions: list[str] = []

    def add_due_frame(self) -> None:
        """Add a frame of the present state if one is due."""
        time = self._run.time
        if time + 1e-9 < self._next_frame_time:
            return
        self._next_frame_time += 1.0 / FRAME_RATE
        frame = self.draw()
        self._writer.add(frame)
        if self._sheet_moments and time >= self._sheet_moments[0][0]:
            self._sheet.append(frame)
            self._captions.append(f"{self._sheet_moments.pop(0)[1]}, {time:.1f} s")

    def draw(self) -> np.ndarray:
        """Draw the present state (height, width, 3)."""
        self._data.qpos[:] = self._run.data.qpos
        return self._renderer.draw(self._data, self._run.solver.positions(), self._camera)

    def close(self) -> None:
        """Finish film and sheet, with the frames so far where the run stopped early."""
        try:
            self._writer.close()
            if self._sheet:
                self._out.write("frames.png", lambda path: write_contact_sheet(self._sheet, self._captions, path))
        finally:
            self._renderer.close()


def _compile_drawn_model(run: RehearsalRun) -> mujoco.MjModel:
    """The rehearsal's scene with its grains and its target area."""
    spec = build_rehearsal_spec(run.config)
    apply_quality(spec)
    if run.config.area is not None:
        add_mark(spec, run.config.area)
    radius = GRAIN_RADIUS * run.grains.grain_volume ** (1 / 3)
    add_grain_skin(spec, len(run.solver.positions()), radius, run.material.colour)
    return compile_spec(spec)


def _choose_sheet_moments(run: RehearsalRun) -> list[tuple[float, str]]:
    """Times [s] and captions of the frames on the sheet.

    Of a script its waypoints, without those that follow most closely on another; of learned motions equal intervals.
    """
    moments = sorted((run.waypoint_time(name), name) for name in run.plan.path.times)
    if run.config.trajectory == "learned":
        times = np.linspace(0.0, run.duration - 1.0 / FRAME_RATE, SHEET_FRAMES)
        return [(float(t), next((name for begin, name in reversed(moments) if begin <= t), "start")) for t in times]
    while len(moments) > SHEET_FRAMES:
        gaps = [b[0] - a[0] for a, b in itertools.pairwise(moments)]
        del moments[int(np.argmin(gaps)) + 1]
    return moments

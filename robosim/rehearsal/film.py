"""The film of a rehearsal: frames at a fixed rate, and nine of them on a sheet."""

import itertools
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from PIL import Image

from mpm.files import write
from robosim.base.errors import UnknownName
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal import COLOURS
from robosim.rehearsal.planning.waypoint_path import is_in_container
from robosim.rehearsal.run import RehearsalRun
from robosim.rendering.cameras import FOLLOW
from robosim.rendering.grain_skin import GRAIN_RADIUS, MARKED_SKIN, add_grain_skin
from robosim.rendering.renderer import SceneRenderer, add_mark, apply_quality
from robosim.rendering.video import Mp4Writer, read_frames, write_caption, write_contact_sheet
from robosim.robot.assembly import HAND_PREFIX
from robosim.robot.mjspec import compile_spec
from robosim.scene.build import assemble_rehearsal, build_rehearsal_spec
from robosim.scene.frames import body_pose
from robosim.scene.grains import is_in_tool

FRAME_RATE = 20
"""Frames per second of simulated time, unless one asks for others: a software renderer keeps pace with the simulation.
"""
SHADOWS = 1024
"""Side [texels] of the shadow map: on a software renderer 2048 take a seventh of the time for nothing that one sees."""
POSTER_SHADOWS, POSTER_SAMPLES = 4096, 8
"""The same of the still, and its samples a pixel."""
ASLEEP = (0.25, 0.38, 0.62, 1.0)
"""Colour of grains that sleep: RGBA."""
SHEET_FRAMES = 9
"""Frames on the sheet."""
FULL, EMPTYING = 0.95, 0.5
"""Shares: of the largest load, from which a tool counts as full, and of what leaves it, from which as emptying."""
DISTANCE, AZIMUTH_DEG, ELEVATION_DEG = 0.62, 205.0, -28.0
"""Of the camera that follows the hand, from what it looks at [m], and its direction [deg]: from the
other side of the table."""
CAMERA_LAG = 0.5
"""Time [s] in which the camera follows: a jerk of the hand does not shake the picture."""


class FilmPlan(NamedTuple):
    """What a film shows, besides the states."""

    config: RehearsalConfig
    camera: str
    grains: int
    """Number of grains."""
    grain_volume: float
    """[m^3]"""
    colour: tuple[float, ...]
    """Of the material: RGBA, 0 to 1."""
    marks_sleepers: bool = False
    """Whether grains that sleep have a colour of their own."""
    rate: int = FRAME_RATE
    """Frames per second."""
    height: int = 720
    """Of a picture [pixels]."""
    poster: float | None = None
    """Time [s] of a still in 1080p with smooth edges; None: there is none."""
    passages: list[tuple[float, str]] = []  # noqa: RUF012
    """Times [s] of the waypoints, and their names, for the captions, and the frames on the sheet."""
    passages_after_dose: list[tuple[float, str]] = []  # noqa: RUF012
    """The same of those after a dose, without the time that it takes."""


class FilmState(NamedTuple):
    """What a frame shows."""

    time: float
    """[s]"""
    qpos: np.ndarray
    """Joint positions of the whole scene."""
    positions: np.ndarray
    """Of the grains [m] (n, 3)."""
    asleep: np.ndarray | None = None
    """Which grains sleep (n,), where they are marked."""
    delay: float = 0.0
    """Time [s] by which a dose that is over has delayed the motion."""


def find_camera(model: mujoco.MjModel, name: str) -> str:
    """Return the name that a camera of the scene, or of the hand in it, has in its model; raises UnknownName."""
    names = [model.camera(k).name for k in range(model.ncam)]
    for found in (name, HAND_PREFIX + name):
        if found in (*names, FOLLOW):
            return found
    raise UnknownName("camera", name, [*(known.removeprefix(HAND_PREFIX) for known in names if known), FOLLOW])


def check_colour(name: str) -> None:
    """Raise UnknownName unless grains can be coloured by this."""
    if name not in COLOURS:
        raise UnknownName("colour", name, COLOURS)


def plan_film(run: RehearsalRun, camera: str, colour: str = "material", rate: int = FRAME_RATE, height: int = 720,
              poster: float | None = None) -> FilmPlan:
    """Return what the film of a run shows; raises UnknownName for a colour, see `COLOURS`."""
    check_colour(colour)
    return FilmPlan(run.config, camera, sum(run.solver.particles.counts), run.grains.grain_volume,
                    tuple(run.material.colour), colour == "awake", rate, height, poster,
                    run.planned_passages(), run.passages_after_dose())


def read_state(run: RehearsalRun, marks_sleepers: bool = False) -> FilmState:
    """Return the present state of a run."""
    return FilmState(run.time, run.data.qpos.copy(), run.solver.positions().astype(np.float32),
                     ~run.solver.awake if marks_sleepers else None, run.delay)


class Film:
    """A film of a rehearsal, drawn with a model of its own: the simulated one has no visual extras.

    Writes rehearsal.mp4 and frames.png into the folder `out`. Raises RenderingUnavailable.
    """

    def __init__(self, plan: FilmPlan, out: Path) -> None:
        self._plan, self._out, self._passages = plan, out, list(plan.passages)
        self._model = _compile_drawn_model(plan)
        self._data, self._camera_name = mujoco.MjData(self._model), find_camera(self._model, plan.camera)
        self._renderer = SceneRenderer(self._model, plan.grains, picture_width(plan.height), even(plan.height))
        hand = assemble_rehearsal(plan.config).wrist
        self._follow = FollowCamera(self._model, hand, plan.config.tool_name) if plan.camera == FOLLOW else None
        self._poster: FilmState | None = None
        self._writer = Mp4Writer(out / "rehearsal.mp4", fps=plan.rate)
        self._tool = self._model.body(plan.config.tool_name).id
        self._loads: list[tuple[float, float]] = []
        """Of every frame: time [s], and number of grains in the tool; none while it digs."""

    def add(self, state: FilmState) -> None:
        """Add a frame."""
        frame = self.draw(state)
        if state.delay > 0.0 and len(self._passages) == len(self._plan.passages):
            self._passages += [(time + state.delay, name) for time, name in self._plan.passages_after_dose]
        if self._plan.poster is not None and self._poster is None and state.time >= self._plan.poster:
            self._poster = state
        self._writer.add(self._caption(frame, state.time))
        self._loads.append((state.time, self._count_load(state)))

    def _count_load(self, state: FilmState) -> float:
        """Return how many grains are in the tool, as the frame that was drawn last has it."""
        pose = body_pose(self._data, self._tool)
        if is_in_container(pose, self._plan.config):
            return np.nan
        return float(is_in_tool(self._plan.config.tool, state.positions, pose).sum())

    def draw(self, state: FilmState) -> np.ndarray:
        """Draw a state (height, width, 3)."""
        self._data.qpos[:] = state.qpos
        return self._renderer.draw(self._data, state.positions, self._camera(state.time), state.asleep)

    def _camera(self, time: float) -> str | mujoco.MjvCamera:
        """Return the film's camera at the time [s] of the state that `_data` has."""
        if self._follow is None:
            return self._camera_name
        mujoco.mj_kinematics(self._model, self._data)
        return self._follow.follow(self._data, time)

    def _caption(self, frame: np.ndarray, time: float) -> np.ndarray:
        """Return a frame with material, time and the waypoint that was passed last."""
        passed = next((name for begin, name in reversed(self._passages) if begin <= time), "grasp")
        picture = Image.fromarray(frame)
        write_caption(picture, f"{self._plan.config.material}   {time:5.2f} s   {passed}")
        return np.asarray(picture)

    def _write_poster(self, state: FilmState) -> None:
        """Draw a state in 1080p with smooth edges, in a context of its own."""
        model = _compile_drawn_model(self._plan, POSTER_SHADOWS, POSTER_SAMPLES)
        renderer = SceneRenderer(model, self._plan.grains, 1920, 1080)
        try:
            frame = renderer.draw(self._data, state.positions, self._camera(state.time), state.asleep)
            write(self._out / "poster.png", lambda path: Image.fromarray(frame).save(path, format="PNG"))
        finally:
            renderer.close()

    def close(self) -> None:
        """Finish film and sheet, with the frames so far where the run stopped early."""
        try:
            self._writer.close()
            if self._loads:
                chosen = choose_frames(np.array(self._loads), self._passages)
                frames = read_frames(self._writer.path, [index for index, _ in chosen])
                captions = [f"{name}, {self._loads[index][0]:.1f} s" for index, name in chosen]
                write(self._out / "frames.png", lambda path: write_contact_sheet(frames, captions, path))
        finally:
            self._renderer.close()
        if self._poster is not None:
            self._data.qpos[:] = self._poster.qpos
            self._write_poster(self._poster)


def picture_width(height: int) -> int:
    """Return the width of a picture of 16 : 9, even as films need it."""
    return 2 * round(height * 8 / 9)


def even(height: int) -> int:
    """Return the height that a film can have."""
    return height - height % 2


def _compile_drawn_model(plan: FilmPlan, shadows: int = SHADOWS, samples: int = 0) -> mujoco.MjModel:
    """The rehearsal's scene with its grains and its target area."""
    spec = build_rehearsal_spec(plan.config)
    apply_quality(spec, shadows, samples)
    if plan.config.area is not None:
        add_mark(spec, plan.config.area)
    radius = GRAIN_RADIUS * plan.grain_volume ** (1 / 3)
    add_grain_skin(spec, plan.grains, radius, plan.colour)
    if plan.marks_sleepers:
        add_grain_skin(spec, plan.grains, radius, ASLEEP, MARKED_SKIN)
    return compile_spec(spec)


def choose_frames(loads: np.ndarray, passages: list[tuple[float, str]]) -> list[tuple[int, str]]:
    """Choose the frames of the sheet, and their names: waypoints, and those in which the tool is full and empties.

    loads (n, 2): time [s] of every frame and number of grains in the tool, not finite while it digs. Of the waypoints,
    those that follow most closely on another frame are left out.
    """
    times, counts = loads.T
    chosen = {int(np.argmin(np.abs(times - time))): name for time, name in passages if time <= times[-1]}
    known, events = np.isfinite(counts), {}
    held = np.interp(times, times[known], counts[known]) if known.any() else np.zeros(len(times))
    if held.max() > 0.0:
        full = np.flatnonzero(held >= FULL * held.max())
        events[int(full[len(full) // 2])] = "full"
        least = held[full[-1] :].min()
        left = np.flatnonzero(held[full[-1] :] < least + EMPTYING * (held.max() - least))
        if least < FULL * held.max():
            events[int(full[-1] + left[0])] = "emptying"
    chosen |= events
    while len(chosen) > SHEET_FRAMES:
        order = sorted(chosen)
        gaps = {b: b - a for a, b in itertools.pairwise(order) if b not in events}
        gaps |= {a: b - a for a, b in itertools.pairwise(order) if b in events and a not in events and a != order[0]}
        del chosen[min(gaps, key=lambda index: gaps[index])]
    return sorted(chosen.items()) or [(0, "start")]


class FollowCamera:
    """A camera that keeps hand and tool in the picture: it looks at the middle between them, smoothly."""

    def __init__(self, model: mujoco.MjModel, hand: str, tool: str) -> None:
        self._tool, self._hand = model.body(tool).id, model.body(hand).id
        self._time: float | None = None
        self.camera = mujoco.MjvCamera()
        self.camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self.camera.distance, self.camera.azimuth, self.camera.elevation = DISTANCE, AZIMUTH_DEG, ELEVATION_DEG

    def follow(self, data: mujoco.MjData, time: float) -> mujoco.MjvCamera:
        """Return the camera at a time [s]; data: with positions of bodies."""
        aim = 0.4 * data.xpos[self._hand] + 0.6 * data.xpos[self._tool]
        share = 1.0 if self._time is None else 1.0 - np.exp(-max(time - self._time, 0.0) / CAMERA_LAG)
        self.camera.lookat[:] += share * (aim - self.camera.lookat)
        self._time = time
        return self.camera

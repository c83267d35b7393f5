"""A film of a run, drawn from its recordings."""

import contextlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from av.error import FFmpegError
from PIL import Image

from mpm.files import write
from robosim.base.errors import ConfigError, RobosimError, UnknownName
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.config.scene import RegionConfig
from robosim.episode import COLOURS, FOLLOW
from robosim.episode.sheet import LOAD, choose_frames, name_passage
from robosim.recordings.appearance import build_appearance
from robosim.recordings.reader import FILE, Recording, find_recordings
from robosim.rendering.grain_skin import MARKED_SKIN, add_grain_skin
from robosim.rendering.renderer import RenderingUnavailable, SceneRenderer, add_mark, apply_quality
from robosim.rendering.video import Mp4Writer, write_caption, write_contact_sheet
from robosim.robot.assembly import HAND_PREFIX
from robosim.robot.mjspec import compile_spec

NAMES = {"rehearsal": "rehearsal.mp4", "task": "episode.mp4"}
"""Kind of a recording -> name of its film."""
CHAIN = "chain.mp4"
"""Name of the film of several."""
CAMERAS = {"task": "task"}
"""Kind of a recording -> camera of its film, where another one than `CLOSE` is usual."""
CLOSE = "close"
SHEET, POSTER = "frames.png", "poster.png"
SHADOWS, POSTER_SHADOWS, POSTER_SAMPLES = 1024, 4096, 8
"""Side [texels] of the shadow map of films (on a software renderer 2048 take a seventh of the time for nothing that one
sees) and of the still, and the still's samples a pixel."""
ASLEEP = (0.25, 0.38, 0.62, 1.0)
"""Colour of grains that sleep: RGBA."""
DISTANCE, AZIMUTH_DEG, ELEVATION_DEG, CAMERA_LAG = 0.62, 205.0, -28.0, 0.5
"""Of the camera that follows the hand: its distance from what it looks at [m], its direction [deg], from the other side
of the table, and the time [s] in which it follows: a jerk of the hand does not shake the picture."""


class FilmFailed(RobosimError, RuntimeError):
    """The film could not be written; the message says why. The recording is complete."""


class FilmStyle(NamedTuple):
    """How a film is drawn."""

    camera: str | None = None
    """Name of a camera of the scene, or of the hand in it; None: the usual one."""
    colour: str = "material"
    """One of `COLOURS`."""
    height: int = 720
    """Of a picture [pixels], 16 : 9."""
    poster: float | None = None
    """Time [s] of a still in 1080p with smooth edges; None: there is none."""


EPISODE = FilmStyle(height=480)
"""How the films of episodes are drawn."""


def film_run(run: Path, folder: Path | None = None, style: FilmStyle | None = None) -> Path:
    """Draw the film of a run, its folder or one of its recordings; return its file.
    folder: None for that of the recordings. A rehearsal has a sheet of frames beside its film. Raises ConfigError for
    what cannot be drawn, UnknownName for camera and colour, RenderingUnavailable, and FilmFailed, as for a full disk.
    """
    style, paths = style or FilmStyle(), find_recordings(run)
    with contextlib.ExitStack() as stack:
        recordings = [stack.enter_context(Recording(path)) for path in paths]
        for recording in recordings:
            if not len(recording) or not recording.appearance:
                raise ConfigError(f"{recording.path}: {'is of an earlier version' if len(recording) else 'no frames'}, "
                                  f"so that no film can be drawn; record the run again")
        folder = folder or paths[0].parent
        first = recordings[0]
        name = CHAIN if len(paths) > 1 else NAMES.get(first.header.kind, "film.mp4")
        if len(paths) == 1 and first.path.name.removesuffix(".part") != FILE:
            name = first.path.name.removesuffix(".part").removesuffix(".rec") + ".mp4"
        try:
            frames = _draw_film(recordings, folder / name, style)
            if first.header.kind == "rehearsal":
                write(folder / SHEET, lambda path: write_contact_sheet(list(frames.values()), list(frames), path))
            if style.poster is not None:
                _draw_poster(first, folder / POSTER, style)
        except (OSError, FFmpegError) as error:
            raise FilmFailed(f"no film: {error}") from error
    return folder / name


def try_film(folder: OutputFolder, style: FilmStyle) -> FilmFailed | None:
    """Draw the film of a run whose other results are complete; return why it could not be written, of `failures`, too.
    Where this machine cannot draw, a line on stderr says so."""
    try:
        film_run(folder.path, style=style)
    except FilmFailed as error:
        folder.failures.append(str(error))
        return error
    except RenderingUnavailable as error:
        print(f"no video: {error}", file=sys.stderr)
    return None


def _draw_film(recordings: Sequence[Recording], path: Path, style: FilmStyle) -> dict[str, np.ndarray]:
    """Draw a film of recordings, one after the other; return the frames of the sheet by their captions."""
    sheet: dict[str, np.ndarray] = {}
    rate = recordings[0].header.frame_rate
    with contextlib.ExitStack() as stack:
        writer: Mp4Writer | None = None
        progress = stack.enter_context(Progress(total=sum(map(len, recordings)), desc="film", unit="frames"))
        for recording in recordings:
            with Pictures(recording, style) as pictures:
                writer = writer or stack.enter_context(Mp4Writer(path, fps=rate))
                times, values = recording.values()
                names = [curve.name for curve in recording.header.curves]
                loads = values[:, names.index(LOAD)] if LOAD in names else np.full(len(times), np.nan)
                chosen = dict(choose_frames(np.column_stack([times, loads]),
                                            [(entry.time, entry.name) for entry in recording.waypoints]))
                for k in range(len(recording)):
                    time = recording.scene(k).time
                    picture = Image.fromarray(pictures.draw(k))
                    passed = name_passage(recording, time)
                    write_caption(picture, f"{recording.header.caption}   {time:5.2f} s   {passed}".strip())
                    frame = np.asarray(picture)
                    writer.add(frame)
                    if k in chosen:
                        sheet[f"{chosen[k]}, {time:.1f} s"] = frame
                    progress.update()
    return sheet


def _draw_poster(recording: Recording, path: Path, style: FilmStyle) -> None:
    """Draw the first frame at or after a time in 1080p with smooth edges; none where the recording ends before."""
    times = recording.values()[0]
    k = int(np.searchsorted(times, style.poster or 0.0))
    if k < len(times):
        with Pictures(recording, style._replace(height=1080), POSTER_SHADOWS, POSTER_SAMPLES) as pictures:
            for earlier in range(k):
                pictures.place(earlier)
            frame = pictures.draw(k)
        write(path, lambda temporary: Image.fromarray(frame).save(temporary, format="PNG"))


def find_camera(model: mujoco.MjModel, name: str, follows: bool = True) -> str:
    """Return the name that a camera of the scene, or of the hand in it, has in its model; raises UnknownName.
    follows: whether there is a hand to be followed."""
    names = [model.camera(k).name for k in range(model.ncam)] + [FOLLOW] * follows
    for found in (name, HAND_PREFIX + name):
        if found in names:
            return found
    raise UnknownName("camera", name, [known.removeprefix(HAND_PREFIX) for known in names if known])


def check_colour(name: str) -> None:
    """Raise UnknownName unless grains can be coloured by this."""
    if name not in COLOURS:
        raise UnknownName("colour", name, COLOURS)


class Pictures:
    """Pictures of the frames of a recording. Raises UnknownName, RenderingUnavailable."""

    def __init__(self, recording: Recording, style: FilmStyle, shadows: int = SHADOWS, samples: int = 0) -> None:
        check_colour(style.colour)
        self._recording, header = recording, recording.header
        spec = build_appearance(recording.appearance, header.bodies, recording.path)
        apply_quality(spec, shadows, samples)
        for region in header.regions:
            if region.is_marked:
                add_mark(spec, RegionConfig(centre=region.position, half=region.half, round=region.round))
        self._marks = style.colour == "awake"
        if header.grains:
            add_grain_skin(spec, header.grains, header.grain_radius, [*header.colour, 1.0])
            if self._marks:
                add_grain_skin(spec, header.grains, header.grain_radius, ASLEEP, MARKED_SKIN)
        self._model = compile_spec(spec)
        self._data = mujoco.MjData(self._model)
        name = find_camera(self._model, style.camera or CAMERAS.get(header.kind, CLOSE), bool(header.hand))
        follow = FollowCamera(self._model, header.hand, header.tool) if name == FOLLOW else None
        self._camera: Callable[[float], str | mujoco.MjvCamera] = lambda time: \
            follow.follow(self._data, time) if follow else name
        width, height = 2 * round(style.height * 8 / 9), style.height - style.height % 2  # even as films need it
        self._renderer = SceneRenderer(self._model, header.grains, width, height)

    def place(self, k: int) -> str | mujoco.MjvCamera:
        """Place the bodies of the k-th frame, later than the one before; return the camera."""
        scene = self._recording.scene(k)
        self._data.mocap_pos[:], self._data.mocap_quat[:] = scene.poses[:, :3], scene.poses[:, 3:]
        mujoco.mj_kinematics(self._model, self._data)
        return self._camera(scene.time)

    def draw(self, k: int) -> np.ndarray:
        """Draw the k-th frame (height, width, 3)."""
        camera, grains = self.place(k), self._recording.grains(k)
        return self._renderer.draw(self._data, grains.positions, camera, ~grains.awake if self._marks else None)

    def __enter__(self) -> "Pictures":
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()


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

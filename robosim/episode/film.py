"""A film of a run, drawn from its recordings."""

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Literal, NamedTuple

import mujoco
import numpy as np
from av.error import FFmpegError
from PIL import Image

from mpm.files import write
from robosim.base.errors import ConfigError, RobosimError
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.config.scene import RegionConfig
from robosim.episode import AUTO
from robosim.episode.cameras import find_camera, make_camera
from robosim.episode.sheet import choose_moment, find_passages, name_dose, name_passage
from robosim.recordings.appearance import build_appearance
from robosim.recordings.reader import FILE, Recording, find_recordings
from robosim.rendering.changes import Changes
from robosim.rendering.filament import FilamentRenderer, FilamentUnavailable, Grains, find_device
from robosim.rendering.grain_skin import add_grain_skin
from robosim.rendering.renderer import RenderingUnavailable, SceneRenderer, add_mark
from robosim.rendering.video import Mp4Writer, write_caption, write_contact_sheet
from robosim.robot.mjspec import compile_spec

NAMES = {"rehearsal": "rehearsal.mp4", "task": "episode.mp4"}
"""Kind of a recording -> name of its film."""
CHAIN = "chain.mp4"
"""Name of the film of several."""
CAMERAS = {"task": "task"}
"""Kind of a recording -> camera of its film, where another one than `AUTO` is usual."""
SHEET, POSTER, POSTER_HEIGHT = "frames.png", "poster.png", 2160


class FilmFailed(RobosimError, RuntimeError):
    """The film could not be written; the message says why. The recording is complete."""


class FilmStyle(NamedTuple):
    """How a film is drawn."""

    camera: str | None = None
    """Name of a camera of the scene, or of the hand in it; None: the usual one."""
    height: int = 720
    """Of a picture [pixels], 16 : 9."""
    poster: float | bool | None = None
    """Time [s] of a still in 4K; True: when the tool empties, or is full; None: there is none."""
    renderer: Literal["auto", "filament", "classic"] = "auto"
    """filament: physically based, of MuJoCo 4; classic: OpenGL; auto: filament where it can draw."""
    begin: float = 0.0
    """Time [s] of the first picture."""
    end: float = np.inf
    """Time [s] of the last picture; a film of a part has no sheet of frames."""

    @property
    def is_whole(self) -> bool:
        """Whether it shows a recording from its first frame to its last."""
        return self.begin <= 0.0 and self.end == np.inf


EPISODE = FilmStyle(height=480)
"""How the films of episodes are drawn."""


def film_run(run: Path, folder: Path | None = None, style: FilmStyle | None = None) -> Path:
    """Draw the film of a run, its folder or one of its recordings; return its file.
    folder: None for that of the recordings. A rehearsal has a sheet of frames beside its film. Raises ConfigError for
    what cannot be drawn, UnknownName for the camera, RenderingUnavailable, FilamentUnavailable, FilmFailed, as for a
    full disk."""
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
            if first.header.kind == "rehearsal" and len(frames) and style.is_whole:
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
        shown = [find_frames(recording, style) for recording in recordings]
        progress = stack.enter_context(Progress(total=sum(map(len, shown)), desc="film", unit="frames"))
        for recording, frames in zip(recordings, shown):
            with Pictures(recording, style) as pictures:
                writer = writer or stack.enter_context(Mp4Writer(path, fps=rate, comment=choose_renderer(style)))
                chosen = find_passages(recording)
                for k, frame in pictures.draw_all(frames):
                    scene, picture = recording.scene(k), Image.fromarray(frame)
                    names, time = [curve.name for curve in recording.header.curves], scene.time
                    words = (recording.header.caption, f"{time:5.2f} s", name_passage(recording, time),
                             name_dose(names, scene.values))
                    write_caption(picture, "   ".join(filter(None, words)))
                    frame = np.asarray(picture)
                    writer.add(frame)
                    if k in chosen:
                        sheet[f"{chosen[k]}, {time:.1f} s"] = frame
                    progress.update()
    return sheet


def _draw_poster(recording: Recording, path: Path, style: FilmStyle) -> None:
    """Draw the first frame at or after a time in 4K; none where the recording ends before."""
    k = choose_moment(recording) if style.poster is True else \
        int(np.searchsorted(recording.values()[0], style.poster or 0.0))
    if k < len(recording):
        with Pictures(recording, style._replace(height=POSTER_HEIGHT)) as pictures:
            frame = pictures.draw(k)
        write(path, lambda temporary: Image.fromarray(frame).save(temporary, format="PNG"))


def find_frames(recording: Recording, style: FilmStyle) -> range:
    """Return the frames of a recording between a style's times; raises ConfigError where there are none."""
    times = recording.values()[0]
    frames = range(*np.searchsorted(times, [style.begin, np.nextafter(style.end, np.inf)]).tolist())
    if not frames:
        raise ConfigError(f"{recording.path}: no frames from {style.begin:g} to {style.end:g} s; accepted: times of "
                          f"{times[0]:.2f} to {times[-1]:.2f} s")
    return frames


def choose_renderer(style: FilmStyle) -> str:
    """Return what draws, as a page names it; empty: OpenGL. Raises FilamentUnavailable where that is asked for."""
    if style.renderer == "classic":
        return ""
    try:
        return find_device().text
    except FilamentUnavailable:
        if style.renderer == "filament":
            raise
        return ""


class Pictures(contextlib.AbstractContextManager["Pictures"]):
    """Pictures of the frames of a recording. Raises UnknownName, RenderingUnavailable, FilamentUnavailable."""

    def __init__(self, recording: Recording, style: FilmStyle) -> None:
        self._recording, header = recording, recording.header
        spec = build_appearance(recording.appearance, header.bodies, recording.path)
        for region in header.regions:
            if region.is_marked:
                add_mark(spec, RegionConfig(centre=region.position, half=region.half, round=region.round))
        by_filament = bool(choose_renderer(style))
        if header.grains and not by_filament:
            add_grain_skin(spec, header.grains, header.grain_radius, [*header.colour, 1.0])
        self._model = compile_spec(spec)
        self._data = mujoco.MjData(self._model)
        name = find_camera(self._model, style.camera or CAMERAS.get(header.kind, AUTO))
        self._camera = make_camera(recording, self._model, self._data, name)
        width, height = 2 * round(style.height * 8 / 9), style.height - style.height % 2  # even as films need it
        if by_filament:
            grains = Grains(header.grains, header.grain_radius, header.colour) if header.grains else None
            self._renderer = FilamentRenderer(self._model, grains, width, height)
        else:
            self._renderer = SceneRenderer(self._model, header.grains, width, height)
        self._changes = Changes(self._model, (height, width), header.grain_radius)
        self._last = np.empty((height, width, 3), np.uint8)

    def draw(self, k: int) -> np.ndarray:
        """Draw the k-th frame (height, width, 3)."""
        return self._begin(k)()

    def draw_all(self, frames: range) -> Iterator[tuple[int, np.ndarray]]:
        """Draw frames, each with its number; each one is finished while the next one is begun, so that no other may be
        drawn meanwhile."""
        with ThreadPoolExecutor(1) as worker:
            begun: list[tuple[int, Future[np.ndarray]]] = []
            for k in frames:
                begun.append((k, worker.submit(self._begin(k))))
                if len(begun) > 1:
                    number, finished = begun.pop(0)
                    yield number, finished.result()
            for number, finished in begun:
                yield number, finished.result()

    def _begin(self, k: int) -> Callable[[], np.ndarray]:
        """Begin the part of a frame that differs from the one begun before; what it returns is called in this order."""
        scene, grains = self._recording.scene(k), self._recording.grains(k).positions
        self._data.mocap_pos[:], self._data.mocap_quat[:] = scene.poses[:, :3], scene.poses[:, 3:]
        camera = self._camera(scene.time)
        part = self._changes.find(self._data, grains, camera, self._renderer.find_light(self._data))
        if 0 in part.shape:
            return lambda: self._last
        drawn = self._renderer.begin(self._data, grains, camera, part)

        def finish() -> np.ndarray:
            picture = self._last.copy()
            picture[part.rows, part.columns] = drawn()
            self._last = picture
            return picture

        return finish

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

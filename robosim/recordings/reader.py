"""Reading a recording: its scene, and any of its frames."""

import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, BinaryIO, TypeVar

import numpy as np
import pydantic
import zstandard

from robosim.base.errors import ConfigError
from robosim.config.bounds import MAX_ENTRIES
from robosim.config.table import describe, list_errors
from robosim.recordings.frames import KEY_INTERVAL, GrainCodec, GrainState, SceneState, unpack_scene
from robosim.recordings.header import VERSION, RecordingHeader, WaypointEntry
from robosim.recordings.writer import APPEARANCE, BLOCK, GRAINS, HEADER, MAGIC, PATH, SCENE, SHAPE, WAYPOINTS

FILE = "recording.rec"
"""Name of a recording in the folder of a run."""
MOST_TEXT, MOST_SCENE, MOST_GROUP, KEPT_GROUPS = 1 << 22, 1 << 28, 1 << 28, 2
"""Bytes, unpacked, of all JSON; of all else besides frames; of a group of frames, from one with whole positions to the
next (1.3 million grains); and how many groups are kept. A small file could fill the memory otherwise."""
WAYPOINT_LIST = pydantic.TypeAdapter(Annotated[list[WaypointEntry], pydantic.Field(max_length=MAX_ENTRIES)])
T = TypeVar("T")
Block = tuple[int, int]
"""Where the content of a block lies in the file: its first byte, and its size."""


class Recording(AbstractContextManager["Recording"]):
    """A recording, opened for reading, also while it is still written.
    Raises ConfigError for what is no recording, one of another version, or a damaged one. One that was cut short, as by
    a crash, is read as far as it goes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.shapes: dict[str, bytes] = {}
        """Body -> .glb file."""
        self.paths: dict[str, np.ndarray] = {}
        """Name -> positions (n, 3) [m]."""
        self.appearance = b""
        """What the scene looks like, see `robosim.recordings.appearance`; empty in recordings of earlier versions."""
        self.waypoints: list[WaypointEntry] = []
        """Those of the header, and those that were known later."""
        self._header: RecordingHeader | None = None
        self._room = {True: MOST_TEXT, False: MOST_SCENE}
        self._scenes: list[Block] = []
        self._grains: list[Block] = []
        self._unpack = lru_cache(KEPT_GROUPS)(self._unpack_group)
        try:
            self._file: BinaryIO = path.open("rb")
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
        self.close = self._file.close
        self._next = len(MAGIC)
        try:
            if self._file.read(len(MAGIC)) != MAGIC:
                raise ConfigError(f"{path}: no recording; accepted: {FILE} of a run's folder")
            self.refresh()
            if self._header is None:
                raise ConfigError(f"{path}: ends before its header; record the run again")
        except ConfigError:
            self.close()
            raise

    @property
    def header(self) -> RecordingHeader:
        """What it says about its scene."""
        assert self._header is not None
        return self._header

    @property
    def is_finished(self) -> bool:
        """Whether its run has come to its end: until then, and after a crash, its name ends in .part."""
        return self.path.suffix != ".part" or not self.path.exists()

    def refresh(self) -> int:
        """Read what was appended since; return the number of new frames."""
        before, end = len(self), self._file.seek(0, 2)
        while self._next + BLOCK.size <= end:
            self._file.seek(self._next)
            kind, size = BLOCK.unpack(self._file.read(BLOCK.size))
            start = self._next + BLOCK.size
            if start + size > end:
                break  # still being written, or cut
            self._take(kind, (start, size))
            self._next = start + size
        return len(self) - before

    def _take(self, kind: bytes, place: Block) -> None:
        if kind in (SCENE, GRAINS):
            (self._scenes if kind == SCENE else self._grains).append(place)
            return
        content = self._content(place, self._room[kind in (HEADER, WAYPOINTS)])
        self._room[kind in (HEADER, WAYPOINTS)] -= len(content)
        if kind == HEADER:
            self._header = self._parse_header(content)
            self.waypoints += self._header.waypoints
        elif kind == APPEARANCE:
            self.appearance = content
        elif kind == WAYPOINTS:
            self.waypoints += self._parse(WAYPOINT_LIST.validate_json, content)
        elif kind in (SHAPE, PATH):
            name, _, content = content.partition(b"\n")
            if kind == SHAPE:
                self.shapes[name.decode(errors="replace")] = content
            elif len(content) % 12 == 0:
                self.paths[name.decode(errors="replace")] = np.frombuffer(content, "<f4").reshape(-1, 3)
        else:
            raise self._damage(ValueError(f"at byte {place[0]}: a block of kind {kind!r}"))

    def __len__(self) -> int:
        return min(len(self._scenes), len(self._grains))

    def scene(self, k: int) -> SceneState:
        """Return poses and readings of the k-th frame. Raises ConfigError for a damaged one."""
        try:
            return unpack_scene(self._content(self._scenes[k], MOST_GROUP))
        except ValueError as error:
            raise self._damage(error) from None

    def grains(self, k: int) -> GrainState:
        """Return the grains of the k-th frame. Raises ConfigError for a damaged one."""
        k = range(len(self))[k]
        begin = k - k % KEY_INTERVAL
        return self._unpack(begin, min(begin + KEY_INTERVAL, len(self)))[k - begin]

    def _unpack_group(self, begin: int, end: int) -> list[GrainState]:
        codec, room, frames = GrainCodec(self.header.lower, self.header.upper), MOST_GROUP, []
        try:
            for place in self._grains[begin:end]:
                content = self._content(place, room)
                room -= len(content)
                frames.append(codec.unpack(content))
            return frames
        except ValueError as error:
            raise self._damage(error) from None

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the times (frames,) [s] and the values of the curves (frames, curves) of all frames."""
        scenes = [self.scene(k) for k in range(len(self))]
        return np.array([scene.time for scene in scenes]), np.array([scene.values for scene in scenes])

    def _damage(self, error: ValueError) -> ConfigError:
        return error if isinstance(error, ConfigError) else \
            ConfigError(f"{self.path}: damaged: {error}; record the run again")

    def _content(self, place: Block, most: int) -> bytes:
        """Return a block's content; raises ConfigError above so many bytes, before these are unpacked."""
        self._file.seek(place[0])
        try:
            packed = self._file.read(place[1])
            if zstandard.frame_content_size(packed) > most:
                raise self._damage(ValueError(f"at byte {place[0]}: a block of more than {most} bytes"))
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=max(most, 1))
        except zstandard.ZstdError as error:
            raise self._damage(ValueError(f"at byte {place[0]}: {error}")) from None

    def _parse_header(self, content: bytes) -> RecordingHeader:
        try:
            values = json.loads(content)
        except (ValueError, RecursionError):
            raise ConfigError(f"{self.path}: its header is not JSON; record the run again") from None
        version, commit = map(values.get, ("version", "commit")) if isinstance(values, dict) else (None, "unknown")
        if version != VERSION:
            raise ConfigError(f"{self.path}: recording of version {version}; accepted: {VERSION}; record the run again "
                              f"with this robosim, or view it with the one that wrote it (commit {commit})")
        return self._parse(RecordingHeader.model_validate, values)

    def _parse(self, validate: Callable[[Any], T], values: Any) -> T:
        try:
            return validate(values)
        except pydantic.ValidationError as error:
            text = list_errors(error, values, lambda e: describe(e, RecordingHeader))
            raise ConfigError(f"{self.path}: header: {text}") from None

    def __exit__(self, *_: object) -> None:
        self.close()


def find_recordings(run: Path) -> list[Path]:
    """Return the recordings of a run's folder, also unfinished ones, or the one of a file.
    A folder has that of its run, or else those of its parts, in the order of their names. Raises ConfigError where
    there is none."""
    if run.is_dir():
        own = [path for path in (run / FILE, run / f"{FILE}.part") if path.is_file()]
        found = own[:1] or sorted(path for end in ("*.rec", "*.rec.part") for path in run.glob(end))
        if not found:
            files = ", ".join(sorted(p.name for p in run.iterdir() if not p.name.startswith("."))[:10]) or "nothing"
            raise ConfigError(f"{run}: holds no {FILE} ({files}); accepted: the folder of a run of `robosim rehearse`, "
                              f"`robosim evaluate` or `robosim chain`, made with this version")
        return found
    if not run.name.endswith((".rec", ".rec.part")) or not run.is_file():
        raise ConfigError(f"{run}: neither the folder of a run nor a recording; accepted: one with a {FILE}, or a file")
    return [run]

"""Writing a recording while its run goes on."""

import contextlib
import json
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import zstandard

from robosim.recordings.frames import KEY_INTERVAL, GrainCodec, GrainState, SceneState, pack_scene
from robosim.recordings.header import RecordingHeader, WaypointEntry

MAGIC = b"robosim recording\n"
BLOCK = struct.Struct("<cI")
"""Kind of a block and the number of bytes of its content, which is compressed by Zstandard with a checksum."""
HEADER, APPEARANCE, SHAPE, PATH, SCENE, GRAINS, WAYPOINTS = b"H", b"A", b"S", b"P", b"R", b"G", b"W"
"""Blocks: the header as JSON; what the scene looks like, see `robosim.recordings.appearance`; the shape of a body, its
name and a line's end before a .glb file; a path, its name and a line's end before positions (n, 3) in single precision;
poses and readings of a frame, and after them its grains; further waypoints as JSON."""
LEVEL = 3
"""Of compression: 6 would make files a tenth smaller in three times the time."""


class RecordingWriter:
    """Appends frames to a recording.
    Until `close` it is called `path`.part, which can be read as far as it was written, also after a crash.
    shapes: body -> .glb file. paths: name -> positions (n, 3) [m]. appearance: of `pack_appearance`; without it no film
    can be drawn."""

    def __init__(self, path: Path, header: RecordingHeader, shapes: dict[str, bytes],
                 paths: dict[str, np.ndarray] | None = None, appearance: bytes = b"") -> None:
        self.path, self.frames = path, 0
        self.is_closed = False
        """Whether the recording is finished."""
        self._part = path.with_name(path.name + ".part")
        self._codec = GrainCodec(header.lower, header.upper)
        self._compressor = zstandard.ZstdCompressor(level=LEVEL, write_checksum=True)
        self._file = self._part.open("wb")
        with contextlib.ExitStack() as undo:  # whoever is to close it has it only once it has begun
            undo.callback(self._part.unlink)
            undo.callback(self._file.close)
            self._file.write(MAGIC)
            self._write(HEADER, json.dumps(header.model_dump(mode="json"), allow_nan=False).encode())
            if appearance:
                self._write(APPEARANCE, appearance)
            for name, shape in shapes.items():
                self._write(SHAPE, name.encode() + b"\n" + shape)
            for name, positions in (paths or {}).items():
                self._write(PATH, name.encode() + b"\n" + np.asarray(positions, "<f4").tobytes())
            undo.pop_all()

    def add(self, scene: SceneState, grains: GrainState) -> None:
        """Append a frame. Raises OSError for a full disk."""
        self._write(SCENE, pack_scene(scene))
        self._write(GRAINS, self._codec.pack(grains, self.frames % KEY_INTERVAL == 0))
        self.frames += 1

    def add_waypoints(self, waypoints: Sequence[WaypointEntry]) -> None:
        """Append waypoints whose times were not known at the beginning."""
        self._write(WAYPOINTS, json.dumps([entry.model_dump(mode="json") for entry in waypoints]).encode())

    def _write(self, kind: bytes, content: bytes) -> None:
        block = self._compressor.compress(content)
        self._file.write(BLOCK.pack(kind, len(block)) + block)
        self._file.flush()

    def close(self) -> None:
        """Finish the recording under its name. May be called twice, also where an interrupt cut off the first call."""
        if not self.is_closed:
            self._file.close()
            if self._part.exists():
                self._part.replace(self.path)
            self.is_closed = True

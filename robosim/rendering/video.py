"""Films in H.264 and contact sheets, written under a temporary name and renamed when complete."""

import contextlib
import io
import itertools
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mpm.files import rename, temporary_path, write

Frame = NDArray[np.uint8]
"""Picture (height, width, 3), RGB."""

KEYFRAME_SECONDS = 2
SHEET_COLUMNS = 3
PICTURE_WIDTH = 640
"""Width [pixels] of one picture on the sheet."""


class Mp4Writer(contextlib.AbstractContextManager["Mp4Writer"]):
    """Writes frames to an H.264 film in yuv420p, which every player opens.
    Until close() the film has a temporary name; one that cannot be finished is removed. Raises ValueError for frames of
    another size or an odd one, OSError for a full disk. keyframes: frames from one key frame to the next; None:
    KEYFRAME_SECONDS of them. comment: kept in the film."""

    def __init__(self, path: str | Path, fps: float = 30, keyframes: int | None = None, comment: str = "") -> None:
        if not fps > 0:
            raise ValueError(f"film {path}: fps is {fps:g}; accepted: above 0")
        self.path, self._keyframes = Path(path), keyframes or max(1, round(KEYFRAME_SECONDS * fps))
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._part = temporary_path(self.path)
        self._fps, self._is_closed = fps, False
        self._stream: av.VideoStream | None = None
        self._file = av.open(str(self._part), "w", format="mp4", options={"movflags": "faststart"})
        self._file.metadata["comment"] = comment

    def add(self, frame: Frame) -> None:
        """Append one frame (height, width, 3); all have the size of the first, with even sides."""
        height, width = frame.shape[:2]
        if self._stream is None:
            if height % 2 or width % 2:  # yuv420p halves the resolution of colour
                raise ValueError(f"film {self.path}: frames are {width} x {height}; accepted: even sides")
            self._stream = self._file.add_stream(
                "libx264", rate=Fraction(self._fps).limit_denominator(1000),
                options={"crf": "20", "preset": "veryfast", "g": str(self._keyframes)})
            self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
        expected = (self._stream.height, self._stream.width, 3)
        if frame.shape != expected or frame.dtype != np.uint8:
            raise ValueError(f"film {self.path}: frame {frame.shape} {frame.dtype}; accepted: {expected} uint8")
        self._file.mux(self._stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))

    def close(self) -> None:
        """Finish the film under its final name; without frames no file is left. May be called twice."""
        if self._is_closed:
            return
        try:
            if self._stream is not None:
                self._file.mux(self._stream.encode())
            self._file.close()
            if self._stream is not None:
                rename(self._part, self.path)
        finally:
            self.discard()

    def discard(self) -> None:
        """Remove the film, unless it is finished."""
        self._is_closed = True
        with contextlib.suppress(OSError):  # of a full disk
            self._file.close()
        self._part.unlink(missing_ok=True)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the film; after an error remove it, because it is incomplete."""
        (self.close if kind is None else self.discard)()


def read_frames(path: Path, count: int) -> list[Frame]:
    """Return `count` frames of a film, evenly spaced from its first to its last; all of a film with fewer."""
    with av.open(str(path)) as film:
        number = film.streams.video[0].frames or sum(1 for _ in film.decode(video=0))
        film.seek(0)
        wanted = np.linspace(0, number - 1, count).round().astype(int)
        return [frame.to_ndarray(format="rgb24") for k, frame in enumerate(film.decode(video=0)) if k in wanted]


def read_comment(path: Path) -> str:
    """Return the comment that a film was written with."""
    with av.open(str(path)) as film:
        return film.metadata.get("comment", "")


def read_frame(path: Path, k: int) -> bytes:
    """Return the k-th frame of a film as a .jpg file."""
    stream = io.BytesIO()
    with av.open(str(path)) as film:
        frame = next(itertools.islice(film.decode(video=0), k, None))
        Image.fromarray(frame.to_ndarray(format="rgb24")).save(stream, format="JPEG", quality=88)
    return stream.getvalue()


def write_contact_sheet(frames: list[Frame], captions: list[str], path: str | Path) -> None:
    """Write one to nine frames (height, width, 3) with captions as one PNG.
    Frames have one size; three are in a row. Raises ValueError for other numbers of frames or captions."""
    if not 1 <= len(frames) <= SHEET_COLUMNS**2 or len(captions) != len(frames):
        raise ValueError(f"contact sheet: {len(frames)} frames, {len(captions)} captions; accepted: 1 to 9, as many of "
                         f"each")
    height = round(PICTURE_WIDTH * frames[0].shape[0] / frames[0].shape[1])
    rows = -(-len(frames) // SHEET_COLUMNS)
    sheet = Image.new("RGB", (SHEET_COLUMNS * PICTURE_WIDTH, rows * height), "white")
    for k, (frame, caption) in enumerate(zip(frames, captions)):
        picture = Image.fromarray(frame).resize((PICTURE_WIDTH, height), Image.Resampling.LANCZOS)
        write_caption(picture, caption, at_top=True)
        sheet.paste(picture, (k % SHEET_COLUMNS * PICTURE_WIDTH, k // SHEET_COLUMNS * height))
    write(Path(path), lambda temporary: sheet.save(temporary, format="PNG"))


def write_caption(picture: Image.Image, caption: str, *, at_top: bool = False) -> None:
    """Draw a caption on a dark strip in the picture's lower left corner, or in its upper one."""
    place = (16, 14 if at_top else picture.height - 40)
    font = ImageFont.load_default(size=20)
    draw = ImageDraw.Draw(picture, "RGBA")
    left, top, right, bottom = draw.textbbox(place, caption, font=font)
    draw.rectangle((left - 10, top - 8, right + 10, bottom + 8), fill=(20, 22, 26, 190))
    draw.text(place, caption, font=font, fill=(255, 255, 255, 255))

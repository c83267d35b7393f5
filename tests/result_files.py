"""Checks of the files of a command, however it ended."""

import csv
import json
import zipfile
from pathlib import Path

import av
import numpy as np
import yaml
from PIL import Image
from tensorboard.backend.event_processing.event_file_loader import EventFileLoader

from robosim.base.files import TEMPORARY


class Broken(Exception):
    """A file under its final name that is not whole."""


def check_files(out: Path) -> None:
    """Read every file that has its final name; raises Broken for one that is not whole."""
    for path in sorted(out.rglob("*")):
        if path.is_file() and not find_unfinished(path):
            try:
                READERS.get(path.suffix, Path.read_bytes)(path)
            except Exception as error:
                raise Broken(f"{path} is not whole: {type(error).__name__}: {error}") from error


def find_unfinished(path: Path) -> list[str]:
    """Return the names of unfinished files: of a path itself, or in a folder."""
    paths = path.rglob("*") if path.is_dir() else [path]
    return [one.name for one in paths if one.suffix == ".part" or any(map(TEMPORARY.fullmatch, one.parts))]


def read_npz(path: Path) -> None:
    with np.load(path, allow_pickle=False) as arrays:
        for array in arrays.values():
            assert array is not None


def read_film(path: Path) -> None:
    """Decode all frames; a finished film has its index first and at least a frame."""
    with av.open(str(path)) as film:
        assert sum(1 for _ in film.decode(video=0)) > 0


def read_archive(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None


def read_picture(path: Path) -> None:
    with Image.open(path) as picture:
        picture.load()


def read_rows(path: Path) -> list[list[str]]:
    """Return the rows of a table, without its head; none without a file."""
    if not path.is_file():
        return []
    text = path.read_text()
    rows = list(csv.reader(text.splitlines()))
    assert text.endswith("\n") and len({len(row) for row in rows}) == 1
    if rows[0][0] == "episode":
        assert [row[0] for row in rows[1:]] == [str(k) for k in range(len(rows) - 1)]
    return rows[1:]


def read_lines(path: Path) -> None:
    """Parse the lines of a .jsonl file; a last one without its end was cut off by a kill."""
    for line in path.read_text().split("\n")[:-1]:
        json.loads(line)


def read_page(path: Path) -> None:
    assert path.read_text().rstrip().endswith("</html>")


def read_status(out: Path) -> str | None:
    """Return the state in status.json, None without a file."""
    path = out / "status.json"
    return json.loads(path.read_text())["state"] if path.is_file() else None


def read_events(out: Path) -> list[tuple[int, int]]:
    """Return step and number of values of all events; there is one log, however often a run was continued."""
    path, = out.glob("*tfevents*") if list(out.glob("*tfevents*")) else [None]
    if path is None:
        return []
    return [(event.step, len(event.summary.value)) for event in EventFileLoader(str(path)).Load()]


READERS = {".json": lambda path: json.loads(path.read_text()), ".jsonl": read_lines, ".csv": read_rows,
           ".npz": read_npz, ".mp4": read_film, ".zip": read_archive, ".png": read_picture, ".html": read_page,
           ".yaml": lambda path: yaml.safe_load(path.read_text())}
"""End of a file's name -> its reader."""

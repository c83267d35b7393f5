"""Files written beside their place and renamed, so that what is there is always whole."""

import json
import os
from collections.abc import Callable
from pathlib import Path


def write(path: Path, writer: Callable[[Path], object]) -> None:
    """Let `writer` write a file beside `path`, then rename it."""
    beside = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        writer(beside)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def write_json(path: Path, value: object) -> None:
    """Indented JSON; refuses numbers that JSON does not know."""
    text = json.dumps(value, indent=2, allow_nan=False) + "\n"
    write(path, lambda place: place.write_text(text))

"""Files of a run: written beside and renamed, so that what is there is always whole."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import yaml
from filelock import FileLock, Timeout

from robosim.errors import ConfigError


def aligned(lines: list[list[str]]) -> str:
    """Lines of words in columns, for a terminal."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def replaced(final: Path, writer: Callable[[Path], object]) -> None:
    """Let `writer` write a file beside its place, then rename it; a failure leaves the old file as it was."""
    beside = final.with_name(f".{final.stem}.part{final.suffix}")
    try:
        writer(beside)
        os.replace(beside, final)
    finally:
        beside.unlink(missing_ok=True)


class OutputFolder:
    """The folder given as `--out`, checked before any work and kept from other processes as long as this lives; raises
    ConfigError where it cannot be written or one is at work there."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = FileLock(path / ".lock", is_singleton=True)  # a notebook may come back after an error
            self._lock.acquire(timeout=0)
        except Timeout:
            raise ConfigError(f"--out {path}: another process is at work there; wait for it, or give another folder"
                              ) from None
        except OSError as error:
            raise ConfigError(f"--out {path}: cannot be written ({error.strerror}); give another folder") from None

    def release(self) -> None:
        """Let others work in the folder."""
        self._lock.release()

    def write(self, name: str, writer: Callable[[Path], object]) -> Path:
        """As `replaced` does; returns where it lies."""
        final = self.path / name
        replaced(final, writer)
        return final

    def clear(self, names: tuple[str, ...]) -> None:
        """Take away what an earlier run left."""
        for name in names:
            (self.path / name).unlink(missing_ok=True)

    def write_yaml(self, name: str, value: dict) -> Path:
        """A table in the order given."""
        text = yaml.safe_dump(value, sort_keys=False)
        return self.write(name, lambda path: path.write_text(text))

    def write_json(self, name: str, value: object) -> Path:
        """Indented JSON; refuses numbers that JSON does not know."""
        text = json.dumps(value, indent=2, allow_nan=False)
        return self.write(name, lambda path: path.write_text(text + "\n"))

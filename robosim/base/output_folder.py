"""The folder of a command's results: kept from other processes, with files that are always whole and a status."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import yaml
from filelock import FileLock, Timeout

from mpm.files import write
from robosim.base.errors import ConfigError
from robosim.base.files import LOG, STATUS, keep_status, remove_temporary, write_json

LOCK = ".lock"
"""File of a folder by which a process keeps it from others; also the mark of a folder of results."""


def is_locked(folder: Path) -> bool:
    """Return whether another process is at work in a folder."""
    if not folder.is_dir():
        return False
    try:
        with FileLock(folder / LOCK).acquire(timeout=0):
            return False
    except Timeout:
        return True


def aligned(lines: list[list[str]]) -> str:
    """Lines of words in columns, for a terminal."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


class OutputFolder:
    """The folder given as `--out`, checked before any work and kept from other processes as long as this lives.
    In a `with` statement status.json of one that is not shared says how far the work has come: "running", then
    "finished", "interrupted" or "failed", the last also where `failures` has a reason. Raises ConfigError where the
    folder cannot be written, another process is at work there, or, unless it is shared, it has files and is none of an
    earlier run."""

    def __init__(self, path: Path, is_shared: bool = False) -> None:
        self.path, self._status, self._is_shared = path, contextlib.ExitStack(), is_shared
        self.failures = list[str]()
        """What failed although the work goes on, so that the command's exit status will be 1."""
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._is_marked = (path / LOCK).exists() or not is_shared
            others = sorted(one.name for one in path.iterdir() if one.name[0] != "." and one.name != LOG)
            if others and not (is_shared or (path / LOCK).exists() or (path / STATUS).exists()):
                raise ConfigError(f"--out {path}: holds other files, such as {others[0]}; accepted: a new or empty "
                                  f"folder, or one of an earlier run")
            self._lock = FileLock(path / LOCK, is_singleton=True)  # a notebook may come back after an error
            self._lock.acquire(timeout=0)
        except Timeout:
            raise ConfigError(f"--out {path}: another process is at work there; wait for it, or give another folder"
                              ) from None
        except OSError as error:
            raise ConfigError(f"--out {path}: cannot be written ({error.strerror}); give another folder") from None
        remove_temporary(path)

    def __enter__(self) -> "OutputFolder":
        self._status.callback(self.release)
        if not self._is_shared:
            self.failures = self._status.enter_context(keep_status(self.path))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._status.__exit__(kind, error, trace)

    def release(self) -> None:
        """Let others work in the folder, which gets no mark of a folder of results by being shared."""
        if not self._is_marked:
            (self.path / LOCK).unlink(missing_ok=True)
        self._lock.release()

    def write(self, name: str, writer: Callable[[Path], object]) -> Path:
        """Write a file as `mpm.files.write` does; return its path."""
        final = self.path / name
        write(final, writer)
        return final

    def clear(self, names: tuple[str, ...]) -> None:
        """Remove what an earlier run left, also what it did not finish."""
        for name in (*names, *(f"{name}.part" for name in names)):
            (self.path / name).unlink(missing_ok=True)

    def write_text(self, name: str, text: str) -> Path:
        """Write a text."""
        return self.write(name, lambda path: path.write_text(text, encoding="utf-8"))

    def write_yaml(self, name: str, value: dict) -> Path:
        """Write a table in the order given."""
        return self.write_text(name, yaml.safe_dump(value, sort_keys=False))

    def write_json(self, name: str, value: object) -> Path:
        """Write indented JSON; refuses numbers that JSON does not know."""
        write_json(self.path / name, value)
        return self.path / name

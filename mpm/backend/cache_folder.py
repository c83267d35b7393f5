"""Folders for caches: the one that is wanted, or a temporary one of the user where that cannot be written."""

import os
import stat
import sys
import tempfile
import time
from pathlib import Path

BLOCK = 4096  # bytes written to see whether a folder takes any
KERNEL_LOCK, STALE = "ticache.lock", 60.0
"""Taichi's lock on a folder of kernels, a file that is there for less than a second; age [s] from which it is no
longer anybody's."""
_is_reported = False  # whether this process has said where its caches are instead


def writable_folder(wanted: Path | None, name: str) -> Path:
    """Return the folder `wanted`, or where it cannot be written one of this name in a temporary folder.
    wanted: None where the environment names no folder. The first temporary one in a process is reported on stderr.
    Raises OSError where no temporary folder can be written either."""
    global _is_reported
    try:
        if wanted is None:
            raise OSError("neither XDG_CACHE_HOME nor HOME is set")
        _check(wanted)
        return wanted
    except OSError as error:
        reason = f"cannot write the cache folder {wanted}: {error.strerror}" if error.strerror else str(error)
    try:
        folder = _temporary_folder() / name
        _check(folder)
    except OSError as error:
        raise OSError(f"{reason}; nor a temporary folder: {error}; accepted: a folder that can be written in "
                      f"XDG_CACHE_HOME or TMPDIR") from error
    if not _is_reported:
        print(f"mpm: {reason}; caches are in {folder.parent}", file=sys.stderr)
        _is_reported = True
    return folder


def user_cache_folder() -> Path | None:
    """Return the user's cache folder as the XDG specification has it, or None where the environment names none."""
    for variable, below in (("XDG_CACHE_HOME", ""), ("HOME", ".cache")):
        path = Path(os.environ.get(variable, ""))
        if path.is_absolute():  # a relative one is to be ignored
            return path / below
    return None


def remove_stale_lock(folder: Path) -> None:
    """Remove a lock that a killed process left in a folder of compiled kernels, and say so on stderr.
    With such a lock Taichi 1.7 neither reads nor stores kernels, for ever and without a word."""
    lock = folder / KERNEL_LOCK
    try:
        age = time.time() - lock.stat().st_mtime
        if age > STALE:
            lock.unlink()
            print(f"mpm: removed {lock}, which a killed process left {age:.0f} s ago: with it no kernel was stored",
                  file=sys.stderr)
    except FileNotFoundError:
        pass  # there is none, or another process has removed it
    except OSError as error:
        print(f"mpm: no kernels are stored while {lock} exists, and it cannot be removed: {error.strerror}",
              file=sys.stderr)


def _check(folder: Path) -> None:
    """Make a folder, unless the user's home is missing, and write to it; raises OSError."""
    home = Path(os.path.expanduser("~"))
    if folder.is_relative_to(home):  # a home that is missing on purpose, such as /nonexistent, is not made
        home.stat()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(bytes(BLOCK))


def _temporary_folder() -> Path:
    """Return a temporary folder that only this user can write, the same in all processes where that is safe.
    Cached kernels are run, so that a folder which another user made or can write is not used."""
    if not hasattr(os, "getuid"):  # Windows: temporary folders are the user's own
        return Path(tempfile.gettempdir()) / "robosim-cache"
    folder = Path(tempfile.gettempdir()) / f"robosim-cache-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        found = folder.lstat()
        is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
        if not is_own:
            return Path(tempfile.mkdtemp(prefix=f"{folder.name}-"))
    return folder

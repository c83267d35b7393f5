"""Results on disk: texts and JSON that are always whole, and the status of a folder of results."""

import contextlib
import csv
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mpm.files import write

TEMPORARY = re.compile(r"\..+\.[0-9a-f]{8}\.part(\.\w+)?")
"""Names of files and folders that are not finished."""
STATUS = "status.json"
"""File of a folder of results that says how far the work has come."""
LOG = "log.txt"
"""File that a sweep begins in the folder of a run."""
ROWS = "rows"
"""Folder of the rows of a study in a folder of results."""


def write_text(path: Path, text: str) -> None:
    """Write a text as `write` does."""
    write(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_json(path: Path, value: object) -> None:
    """Write indented JSON. Raises ValueError for numbers that JSON does not have (NaN, infinity)."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as a CSV file with the columns of all of them, as `write` does."""
    def write_table(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, list(dict.fromkeys(name for row in rows for name in row)))
            table.writeheader()
            table.writerows(rows)

    write(path, write_table)


def append(path: Path, data: bytes) -> None:
    """Append to a file and flush it to the disk; after a failure the file is as long as before."""
    size = path.stat().st_size if path.is_file() else 0
    try:
        with path.open("ab") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        with contextlib.suppress(OSError):
            os.truncate(path, size)
        raise


def write_status(folder: Path, state: str, **more: object) -> None:
    """Write status.json: "running", "finished", "interrupted" or "failed", this process's id, and more.
    A status that cannot be written is removed, because the earlier one no longer holds; then raises OSError."""
    path = folder / STATUS
    try:
        write_json(path, {"state": state, "process": os.getpid(), **more})
    except OSError:
        path.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def keep_status(folder: Path) -> Iterator[list[str]]:
    """Keep status.json of a folder while work is done there: "running", then how the work ended, with the reason.
    Gives a list for what failed while the work went on, which then has "failed", too."""
    failures = list[str]()
    try:
        write_status(folder, "running")
        yield failures
        state, more = ("failed", {"reason": "; ".join(failures)}) if failures else ("finished", {})
        write_status(folder, state, **more)
    except BaseException as error:
        with contextlib.suppress(OSError):  # the error that ended the work is the one to report
            write_status(folder, end_state(error), reason=describe_end(error))
        raise


def end_state(error: BaseException) -> str:
    """Return the state of work that an exception ended."""
    return "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"


def describe_end(error: BaseException) -> str:
    """Return why work ended, in a line; the argument of a KeyboardInterrupt is the signal's name."""
    if isinstance(error, KeyboardInterrupt):
        return f"stopped by {error.args[0] if error.args else 'Ctrl-C'}"
    return f"{type(error).__name__}: {error}"


def remove_temporary(folder: Path) -> None:
    """Remove what killed processes left unfinished in a folder and in that of its rows; only for the process that holds
    the folder's lock."""
    for path in (*folder.iterdir(), *(folder / ROWS).glob(".*")):
        if TEMPORARY.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True)
            with contextlib.suppress(OSError):  # a file that another user left stays
                path.unlink()

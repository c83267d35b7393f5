"""Learning curves in TensorBoard's format, in one file that a resumed run continues."""

import io
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.logger import KVWriter, Logger
from tensorboard.compat.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]
from tensorboard.compat.proto.summary_pb2 import Summary  # pyright: ignore[reportAttributeAccessIssue]
from tensorboard.summary.writer.record_writer import RecordWriter

from robosim.base.files import append

PENDING = ("name_to_value", "name_to_count", "name_to_excluded")
"""Attributes of a logger with the values that it has not written."""


class EventLog(KVWriter):
    """Writes the scalars of Stable-Baselines3's logger.
    size: bytes of an earlier log that the run continues after."""

    def __init__(self, path: Path, size: int) -> None:
        self._path = path
        if size < self._size:
            os.truncate(path, size)
        if not self._size:
            self._append(Event(wall_time=time.time(), file_version="brain.Event:2"))

    @property
    def _size(self) -> int:
        return self._path.stat().st_size if self._path.is_file() else 0

    def state(self, logger: Logger) -> dict[str, Any]:
        """Return what a checkpoint needs: the size of the file, and the logger's values that it is yet to get."""
        return {"size": self._size, **{name: dict(getattr(logger, name)) for name in PENDING}}

    @classmethod
    def resume(cls, path: Path, state: dict[str, Any]) -> Logger:
        """Return the logger of a run that continues after a state."""
        logger = Logger(str(path.parent), [cls(path, state["size"])])
        for name in PENDING:
            getattr(logger, name).update(state[name])
        return logger

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        """Write the values of a step."""
        values = [Summary.Value(tag=key, simple_value=float(value)) for key, value in sorted(key_values.items())
                  if "tensorboard" not in (key_excluded[key] or ()) and isinstance(value, int | float | np.number)]
        self._append(Event(wall_time=time.time(), step=step, summary=Summary(value=values)))

    def close(self) -> None:
        """Do nothing: the file is open only while it is written to."""

    def _append(self, event: Any) -> None:
        record = io.BytesIO()
        RecordWriter(record).write(event.SerializeToString())
        append(self._path, record.getvalue())

"""Seconds that parts of a running scene take, measured by wrapping methods."""

import time
from collections import defaultdict
from typing import Any


class Stopwatch:
    """Times methods of objects; the time of a method called by another is subtracted from the outer one's."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        """Name -> wall time [s]."""
        self._inside: list[list[Any]] = []

    def wrap(self, owner: Any, method: str, name: str) -> None:
        """Wrap `owner.method`, so that its time is added to `seconds[name]`."""
        inner = getattr(owner, method)

        def timed(*arguments: Any, **options: Any) -> Any:
            frame = [name, 0.0]
            self._inside.append(frame)
            begin = time.perf_counter()
            try:
                return inner(*arguments, **options)
            finally:
                taken = time.perf_counter() - begin
                self._inside.pop()
                self.seconds[name] += taken - frame[1]
                if self._inside:
                    self._inside[-1][1] += taken

        setattr(owner, method, timed)

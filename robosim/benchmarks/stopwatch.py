"""Seconds that parts of a running scene take, by standing between callers and methods."""

import time
from collections import defaultdict
from typing import Any


class Stopwatch:
    """Times methods of objects; a method within a method is taken off the outer one."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inside: list[list[Any]] = []

    def watch(self, owner: Any, method: str, name: str) -> None:
        """From now on count what `owner.method` takes under a name."""
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

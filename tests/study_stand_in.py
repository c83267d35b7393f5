"""A launcher in place of processes, for tests of studies."""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from robosim.base.jobs import Command, Ended
from robosim.base.study import Store


class StandIn:
    """Runs nothing: the rows are what a function makes of a job's arguments; RuntimeError is a job that failed."""

    def __init__(self, make_value: Callable[..., Any]) -> None:
        self.make_value = make_value
        self.asked: list[dict[str, Any]] = []
        """Arguments of the jobs that were run, in order."""

    def run(self, commands: Sequence[Command], folder: Path, resumes: bool = True) -> Iterator[Ended]:
        for index, ((_, path), _) in enumerate(commands):
            order = json.loads(Path(path).read_text())
            self.asked.append(order["arguments"])
            try:
                Store(Path(path).parent).keep(order["key"], self.make_value(**order["arguments"]))
                yield Ended(index, "")
            except RuntimeError as error:
                yield Ended(index, str(error))

"""What a run of a case leaves: one JSON line with its choices, its cost and its errors."""

import json
import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field

import mpm
from robosim.scene.settle import settle


@dataclass(frozen=True)
class Record:
    """One run."""

    case: str
    choices: dict[str, float | str | bool | None]
    """What was varied: cells, courant, precision and what belongs to the case."""
    particles: int
    steps: int
    seconds: float
    """Wall time [s] after compilation."""
    compile_seconds: float
    errors: dict[str, float]
    """Errors against the reference, relative to the case's own scale unless the name says a unit."""
    readings: dict[str, float] = field(default_factory=dict)
    """Other figures worth a look."""
    peak_bytes: int = 0

    def line(self) -> str:
        """The record as one line of JSON."""
        return json.dumps(asdict(self))


class Clock:
    """Advances a solver and keeps the time apart that its first launch spends compiling."""

    def __init__(self, solver: mpm.Solver) -> None:
        self.solver = solver
        self.seconds = self.compile_seconds = 0.0

    def advance(self, duration: float) -> None:
        """Advance by `duration` [s]."""
        self.run(lambda: self.solver.advance(duration))

    def run(self, work: Callable[[], object]) -> None:
        """Do something that advances the solver."""
        if self.compile_seconds == 0.0:
            begin = time.perf_counter()
            self.solver.compile()
            self.compile_seconds = time.perf_counter() - begin
        begin = time.perf_counter()
        work()
        self.seconds += time.perf_counter() - begin

    def settle(self, duration: float, window: float = 2e-3) -> None:
        """Advance to rest, see `settling`."""
        settle(self.solver, self.advance, duration, window)

    def record(self, case: str, choices: dict, errors: dict[str, float], **readings: float) -> Record:
        """The run's record."""
        return Record(
            case=case, choices=choices, particles=sum(self.solver.particles.counts), steps=self.solver.steps,
            seconds=self.seconds, compile_seconds=self.compile_seconds,
            errors={name: float(value) for name, value in errors.items()},
            readings={name: float(value) for name, value in readings.items()},
            peak_bytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        )

"""Record of a run, and the solver that times itself for it."""

import json
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

import mpm
from robosim.scene.settle import settle


@dataclass(frozen=True)
class Record:
    """One run of a case."""

    case: str
    """Name of the case."""
    choices: dict[str, float | str | bool | None]
    """Arguments of `measure`: cells, courant, precision and those of the case."""
    particles: int
    """Number of particles."""
    steps: int
    """Number of substeps."""
    seconds: float
    """Wall time [s] after compilation."""
    compile_seconds: float
    """Wall time [s] of compilation."""
    errors: dict[str, float]
    """Errors against the reference, relative to the case's own scale unless the name states a unit."""
    readings: dict[str, float] = field(default_factory=dict)
    """Other figures, without an accepted range."""
    peak_bytes: int = 0
    """Largest memory of the process [bytes]."""

    def to_json(self) -> str:
        """Return the record as one line of JSON."""
        return json.dumps(asdict(self))


class Cost(NamedTuple):
    """What a solver's run took; a record of several solvers adds them up."""

    particles: int
    steps: int
    seconds: float
    """Wall time [s] after compilation."""
    compile_seconds: float
    """Wall time [s] of compilation."""


class TimedSolver:
    """Advances a solver and sums the wall time; compilation, before the first advance, is timed apart."""

    def __init__(self, solver: mpm.Solver) -> None:
        self.solver = solver
        self.seconds = self.compile_seconds = 0.0

    def advance(self, duration: float) -> None:
        """Advance by `duration` [s]."""
        self.run(lambda: self.solver.advance(duration))

    def run(self, work: Callable[[], object]) -> None:
        """Call what advances the solver."""
        if self.compile_seconds == 0.0:
            begin = time.perf_counter()
            self.solver.compile()
            self.compile_seconds = time.perf_counter() - begin
        begin = time.perf_counter()
        work()
        self.seconds += time.perf_counter() - begin

    def settle(self, duration: float, window: float = 2e-3) -> None:
        """Advance by `duration` [s] to rest, damped every `window` [s]; see `robosim.scene.settle`."""
        settle(self.solver, self.advance, duration, window)

    @property
    def cost(self) -> Cost:
        """What the run took so far; not to be asked after the solver is closed."""
        return Cost(sum(self.solver.particles.counts), self.solver.steps, self.seconds, self.compile_seconds)

    def record(self, case: str, choices: dict, errors: dict[str, float], **readings: float) -> Record:
        """Return the record of the run so far."""
        return record_of_several([self.cost], case, choices, errors, readings)


def record_of_several(costs: Sequence[Cost], case: str, choices: dict, errors: dict[str, float],
                      readings: dict[str, float]) -> Record:
    """Return the record of a run of several solvers: sums of steps and times, and the largest number of particles."""
    return Record(
        case=case, choices=choices, particles=max(cost.particles for cost in costs),
        steps=sum(cost.steps for cost in costs), seconds=sum(cost.seconds for cost in costs),
        compile_seconds=sum(cost.compile_seconds for cost in costs),
        errors={name: float(value) for name, value in errors.items()},
        readings={name: float(value) for name, value in readings.items()},
        peak_bytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)

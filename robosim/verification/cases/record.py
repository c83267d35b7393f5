"""Record of a run, and the solver that times itself for it."""

import json
import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field

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

    def record(self, case: str, choices: dict, errors: dict[str, float], **readings: float) -> Record:
        """Return the record of the run so far."""
        return Record(
            case=case, choices=choices, particles=sum(self.solver.particles.counts), steps=self.solver.steps,
            seconds=self.seconds, compile_seconds=self.compile_seconds,
            errors={name: float(value) for name, value in errors.items()},
            readings={name: float(value) for name, value in readings.items()},
            peak_bytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        )

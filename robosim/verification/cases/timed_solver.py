"""A solver whose run time is measured apart from its compilation."""

import resource
import time
from collections.abc import Callable

import mpm
from robosim.scene.grains import settle
from robosim.verification.cases.record import Record


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
        """Advance by `duration` [s] to rest, damped every `window` [s]; see `robosim.scene.grains`."""
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

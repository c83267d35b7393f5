"""A verification case: simulation, runs, expectations and source as one value; and the record of a run."""

import inspect
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from typing import Any, NamedTuple

import mpm
from robosim.scene.settle import settle
from robosim.studies.verification.cases.section import draw_section

Point = tuple[float, float, str]
"""x, y and tooltip."""


@dataclass(frozen=True)
class Record:
    """One run of a case."""

    case: str
    choices: dict[str, float | str | bool | None]
    """Arguments of the case: cells, courant, precision and those of its own."""
    particles: int
    steps: int
    seconds: float
    """Wall time [s] after compilation, and of it."""
    compile_seconds: float
    errors: dict[str, float]
    """Errors against the reference, relative to the case's own scale unless the name states a unit."""
    readings: dict[str, float] = field(default_factory=dict)
    """Other figures, without an accepted range."""
    peak_bytes: int = 0
    """Largest memory of the process [bytes]."""
    picture: str = ""
    """Section through the scene at the end, see `draw_section`; empty where none is drawn."""

    def label(self, *names: str) -> str:
        """Format some choices, which are numbers."""
        return ", ".join(f"{name} {self.choices[name]:g}" for name in names)

    def curve(self, name: str, tooltip: str = "") -> list[Point]:
        """Return the readings "NAME X", with or without a unit after it, as points (X, reading, tooltip)."""
        return [(float(key.removeprefix(name).split()[0]), value, tooltip) for key, value in self.readings.items()
                if key.startswith(f"{name} ")]


class Cost(NamedTuple):
    """What a solver's run took, and its picture, see `Record`; a record of several solvers adds the first four up."""

    particles: int
    steps: int
    seconds: float
    compile_seconds: float = 0.0
    picture: str = ""


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
        return Cost(sum(self.solver.particles.counts), self.solver.steps, self.seconds, self.compile_seconds,
                    draw_section(self.solver))

    def record(self, errors: dict[str, Any], **readings: Any) -> Record:
        """Return the record of the run so far, to which a `Case` adds its name and the choices."""
        return make_record([self.cost], errors, **readings)


def make_record(costs: Sequence[Cost], errors: dict[str, Any], **readings: Any) -> Record:
    """Return the record of a run of several solvers: sums of steps and times, the largest number of particles, and the
    first picture."""
    particles, steps, seconds, compile_seconds, pictures = zip(*costs)
    return Record(case="", choices={}, particles=max(particles), steps=sum(steps), seconds=sum(seconds),
                  compile_seconds=sum(compile_seconds), errors={name: float(value) for name, value in errors.items()},
                  readings={name: float(value) for name, value in readings.items()},
                  peak_bytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
                  picture=next(filter(None, pictures), ""))


def select(records: Sequence[Record], where: dict[str, Any]) -> list[Record]:
    """Return the records that have these choices."""
    return [record for record in records if all(record.choices.get(key) == value for key, value in where.items())]


def value_of(record: Record, name: str) -> float:
    """Return an error of a record, or its reading of that name."""
    return record.errors[name] if name in record.errors else record.readings[name]


def describe(choices: dict[str, Any]) -> str:
    """Format choices as text."""
    return ", ".join(f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}"
                     for key, value in choices.items())


class Finding(NamedTuple):
    """An expectation and the value found for it."""

    claim: str
    found: float | None
    """The value furthest from the accepted range; None: no run measures it."""
    low: float
    """Lower end of the accepted range, `high` the upper one."""
    high: float
    unit: str = ""
    """Of all three; empty where the error is relative."""

    @property
    def verdict(self) -> str:
        """"pass", "fail" or "not run"; a value that is not a number fails."""
        if self.found is None:
            return "not run"
        return "pass" if self.low <= self.found <= self.high else "fail"


class Expectation:
    """An accepted range of a figure of the runs that have the choices `where`; dataclasses of `expectations`."""

    name: str
    """Error or reading."""
    where: dict[str, Any]

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Return the figure found, or the one furthest from the range."""
        raise NotImplementedError

    def values(self, records: Sequence[Record], where: dict[str, Any] | None = None, name: str = "") -> list[float]:
        """Return the values of the runs that have these choices, too; name: in place of the expectation's."""
        return [value_of(record, name or self.name) for record in select(records, {**self.where, **(where or {})})]

    def finding(self, claim: str, found: float | None, low: float, high: float) -> Finding:
        """Return what was found, with the choices to which the expectation is limited."""
        return Finding(f"{claim} at {describe(self.where)}" if self.where else claim, found, low, high)


@dataclass(frozen=True)
class Comparison:
    """A plot of measured points beside those, or the line, of a reference."""

    title: str
    x: str
    """Title of the axis, with the unit; `y` likewise."""
    y: str
    measured: dict[str, list[Point]]
    """Label of a series -> its points."""
    uncertainty: float
    """Of the reference: absolute in y, or a share of it where `is_relative`."""
    source: str = ""
    """Source of the reference, where it is not that of the case."""
    published: dict[str, list[Point]] = field(default_factory=dict)
    """Label of a series of reference data -> its points."""
    line: Sequence[tuple[float, float]] = ()
    """Corners (x, y) of the reference's line."""
    is_relative: bool = False
    is_logarithmic: bool = False
    is_joined: bool = False
    """Whether lines join the measured points, too."""


@dataclass(frozen=True)
class Case:
    """A simulation with an independent reference solution; the decorator `case` makes one of a function."""

    simulate: Callable[..., Record]
    """Runs the simulation with keyword arguments, its choices; returns errors and readings."""
    source: str
    """Reference solution, and where it is published."""
    sweep: list[dict[str, Any]]
    """Choices of the runs of a whole report; quick: of a quick one."""
    quick: list[dict[str, Any]]
    expectations: Sequence[Expectation]
    main_error: str
    """Error that is plotted over the run time."""
    resolution: str | None = None
    """Choice that refines a run."""
    units: dict[str, str] = field(default_factory=dict)
    """Errors and readings that are not relative -> unit."""
    compare: Callable[[list[Record]], list[Comparison]] = lambda records: []
    """Returns plots of runs beside reference data."""
    options: type | None = None
    """Dataclass of the choices, where they are more than a function's arguments should be."""

    @property
    def name(self) -> str:
        """The function's name."""
        return self.simulate.__name__

    @property
    def defaults(self) -> dict[str, Any]:
        """Choices of a run that names none."""
        if self.options:
            return asdict(self.options())
        return {name: argument.default for name, argument in inspect.signature(self.simulate).parameters.items()}

    def __call__(self, **choices: Any) -> Record:
        """Run the case; return its record, with all choices."""
        record = self.simulate(self.options(**choices)) if self.options else self.simulate(**choices)
        return replace(record, case=self.name, choices=self.defaults | choices)


def case(**parts: Any) -> Callable[[Callable[..., Record]], Case]:
    """Make a case of a function; parts: the other fields of `Case`."""
    return lambda simulate: Case(simulate, **parts)


def grid(**values: Sequence[Any]) -> list[dict[str, Any]]:
    """Return choices of every combination of values; those of the last name vary first."""
    return [dict(zip(values, combination)) for combination in product(*values.values())]

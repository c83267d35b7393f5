"""Claims of a case about its runs, in a form that a report can evaluate."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any

import numpy as np

from robosim.studies.verification.cases.record import Record


@dataclass(frozen=True)
class Finding:
    """A claim and the value found for it."""

    claim: str
    found: float | None
    """The value furthest from the accepted range; None: no run measures it."""
    low: float
    """Lower end of the accepted range."""
    high: float
    """Upper end of the accepted range."""
    unit: str = ""
    """Of all three; empty where the error is relative."""

    @property
    def verdict(self) -> str:
        """"pass", "fail" or "not run"; a value that is not a number fails."""
        if self.found is None:
            return "not run"
        return "pass" if self.low <= self.found <= self.high else "fail"


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


def _condition(where: dict[str, Any]) -> str:
    """Format the choices that a claim is limited to."""
    return f" at {describe(where)}" if where else ""


@dataclass(frozen=True)
class Within:
    """An error lies within a range in every run with these choices; without a lower end the range is symmetric."""

    name: str
    high: float
    where: dict[str, Any] = field(default_factory=dict)
    low: float | None = None

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the value furthest out of the range."""
        low = -self.high if self.low is None else self.low
        values = [value_of(record, self.name) for record in select(records, self.where)
                  if self.name in record.errors or self.name in record.readings]
        furthest = max(values, key=lambda v: np.inf if np.isnan(v) else max(v - self.high, low - v), default=None)
        return Finding(self.name + _condition(self.where), furthest, low, self.high)


@dataclass(frozen=True)
class Order:
    """An error falls at least with this power of the resolution between two runs.

    resolution: name of the choice that sets it, whether it grows ("cells") or shrinks ("cell") with refinement.
    """

    name: str
    resolution: str
    ends: tuple[float, float]
    """Its values in the coarse and in the fine run."""
    least: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the observed order of convergence."""
        errors = [[abs(value_of(r, self.name)) for r in select(records, {**self.where, self.resolution: end})]
                  for end in self.ends]
        claim = f"order of {self.name}, {self.resolution} {self.ends[0]:g} to {self.ends[1]:g}" + _condition(self.where)
        if not all(errors):
            return Finding(claim, None, self.least, np.inf)
        order = np.log(errors[0][0] / errors[1][0]) / abs(np.log(self.ends[1] / self.ends[0]))
        return Finding(claim, float(order), self.least, np.inf)


@dataclass(frozen=True)
class Approach:
    """An error falls with every refinement and keeps its sign: one that passes zero has not converged, and fails.

    resolution: name of the choice that sets it. values: its values, from coarse to fine.
    """

    name: str
    resolution: str
    values: tuple[float, ...]
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the ratio of an error to that of the next coarser run which is furthest from the range 0 to 1."""
        errors = [[value_of(r, self.name) for r in select(records, {**self.where, self.resolution: value})]
                  for value in self.values]
        claim = f"ratio of successive {self.name}, {self.resolution} " \
                + ", ".join(f"{value:g}" for value in self.values) + _condition(self.where)
        if not all(errors):
            return Finding(claim, None, 0.0, 1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = [float(np.divide(fine, coarse)) for pair in pairwise(errors) for coarse, fine in product(*pair)]
        return Finding(claim, max(ratios, key=lambda q: np.inf if np.isnan(q) else max(q - 1.0, -q)), 0.0, 1.0)


@dataclass(frozen=True)
class Rising:
    """A reading rises along a choice."""

    name: str
    along: str
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the smallest rise from one run to the next."""
        rows = sorted((record.choices[self.along], value_of(record, self.name))
                      for record in select(records, self.where))
        smallest = float(np.diff([row[1] for row in rows]).min()) if len(rows) > 1 else None
        return Finding(f"{self.name} rises with {self.along}", smallest, 1e-6, np.inf)


@dataclass(frozen=True)
class Ratio:
    """A reading changes at most by a factor between two values of a choice."""

    name: str
    along: str
    ends: tuple[float, float]
    """Values of the choice; the reading at the second is divided by that at the first."""
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the ratio of the means at both ends."""
        first, second = ([value_of(r, self.name) for r in select(records, {**self.where, self.along: end})]
                         for end in self.ends)
        claim = f"ratio of {self.name}, {self.along} {self.ends[0]:g} to {self.ends[1]:g}" + _condition(self.where)
        found = float(np.mean(second) / np.mean(first)) if first and second else None
        return Finding(claim, found, self.low, self.high)


@dataclass(frozen=True)
class Power:
    """A reading grows with a power of another one: the slope of a straight line through their logarithms."""

    name: str
    by: str
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the power; not a number where a reading is not positive."""
        rows = [(value_of(record, self.by), value_of(record, self.name)) for record in select(records, self.where)]
        claim = f"power of {self.by} in {self.name}" + _condition(self.where)
        if any(not number > 0 for row in rows for number in row):
            return Finding(claim, np.nan, self.low, self.high)
        if len({row[0] for row in rows}) < 2:
            return Finding(claim, None, self.low, self.high)
        x, y = np.log(np.array(rows)).T
        return Finding(claim, float(np.polyfit(x, y, 1)[0]), self.low, self.high)


@dataclass(frozen=True)
class Slope:
    """A reading rises along another one by so much per unit: the slope of a straight line through the runs."""

    name: str
    by: str
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the slope."""
        rows = [(value_of(record, self.by), value_of(record, self.name)) for record in select(records, self.where)]
        claim = f"slope of {self.name} over {self.by}" + _condition(self.where)
        if len({row[0] for row in rows}) < 2:
            return Finding(claim, None, self.low, self.high)
        x, y = np.array(rows).T
        return Finding(claim, float(np.polyfit(x, y, 1)[0]), self.low, self.high)

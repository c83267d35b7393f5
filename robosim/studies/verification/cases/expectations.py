"""Expectations of a case about its runs, in a form that a report can evaluate."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any

import numpy as np

from robosim.studies.verification.cases.case import Case, Finding, Record


def select(records: Sequence[Record], where: dict[str, Any]) -> list[Record]:
    """Return the records that have these choices."""
    return [record for record in records if all(record.choices.get(key) == value for key, value in where.items())]


def value_of(record: Record, name: str) -> float:
    """Return an error of a record, or its reading of that name."""
    return record.errors[name] if name in record.errors else record.readings[name]


def describe(choices: dict[str, Any]) -> str:
    """Format choices as text."""
    return ", ".join(f"{key} {_text(value)}" for key, value in choices.items())


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _limited(text: str, where: dict[str, Any]) -> str:
    """Append the choices to which an expectation is limited."""
    return f"{text} at {describe(where)}" if where else text


def _values(records: Sequence[Record], name: str, where: dict[str, Any]) -> list[float]:
    """Return the values of the runs that have these choices."""
    return [value_of(record, name) for record in select(records, where)]


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
        measured = [record for record in records if self.name in record.errors or self.name in record.readings]
        values = _values(measured, self.name, self.where)
        furthest = max(values, key=lambda v: np.inf if np.isnan(v) else max(v - self.high, low - v), default=None)
        return Finding(_limited(self.name, self.where), furthest, low, self.high)


def each_within(tolerances: dict[str, float], where: dict[str, Any] | None = None,
                low: float | None = None) -> tuple[Within, ...]:
    """Return the expectations that several errors lie within their tolerances."""
    return tuple(Within(name, high, where or {}, low) for name, high in tolerances.items())


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
        coarse, fine = (_values(records, self.name, {**self.where, self.resolution: end}) for end in self.ends)
        claim = _limited(f"order of {self.name}, {self.resolution} {self.ends[0]:g} to {self.ends[1]:g}", self.where)
        order = float(np.log(abs(coarse[0]) / abs(fine[0])) / abs(np.log(self.ends[1] / self.ends[0]))) \
            if coarse and fine else None
        return Finding(claim, order, self.least, np.inf)


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
        errors = [_values(records, self.name, {**self.where, self.resolution: value}) for value in self.values]
        claim = _limited(f"ratio of successive {self.name}, {self.resolution} "
                         + ", ".join(f"{value:g}" for value in self.values), self.where)
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
    ends: tuple[float | str, float | str]
    """Values of the choice; the reading at the second is divided by that at the first."""
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the ratio of the means at both ends."""
        first, second = (_values(records, self.name, {**self.where, self.along: end}) for end in self.ends)
        ends = " to ".join(_text(end) for end in self.ends)
        claim = _limited(f"ratio of {self.name}, {self.along} {ends}", self.where)
        found = float(np.mean(second) / np.mean(first)) if first and second else None
        return Finding(claim, found, self.low, self.high)


@dataclass(frozen=True)
class Slope:
    """A reading rises along another one by so much per unit: the slope of a straight line through the runs."""

    name: str
    by: str
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the slope; of a `Power` not a number where a reading is not positive."""
        x, y = (np.array(_values(records, name, self.where)) for name in (self.by, self.name))
        is_power, found = isinstance(self, Power), None
        if is_power and not (np.all(x > 0) and np.all(y > 0)):
            found = np.nan
        elif len(set(x)) > 1:
            found = float(np.polyfit(np.log(x) if is_power else x, np.log(y) if is_power else y, 1)[0])
        text = f"power of {self.by} in {self.name}" if is_power else f"slope of {self.name} over {self.by}"
        return Finding(_limited(text, self.where), found, self.low, self.high)


class Power(Slope):
    """A reading grows with a power of another one: the slope of a straight line through their logarithms."""


def judge(case: Case, records: Sequence[Record]) -> list[Finding]:
    """Return what runs of a case show for each of its expectations, with units."""
    return [one.evaluate(records)._replace(unit=case.units.get(one.name, "") if isinstance(one, Within) else "")
            for one in case.expectations]

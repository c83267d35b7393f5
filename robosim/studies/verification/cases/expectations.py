"""Expectations of a case about its runs, in a form that a report can evaluate."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any

import numpy as np

from robosim.studies.verification.cases.case import Case, Expectation, Finding, Record


@dataclass(frozen=True)
class Within(Expectation):
    """An error lies within a range in every run with these choices; without a lower end the range is symmetric."""

    name: str
    high: float
    where: dict[str, Any] = field(default_factory=dict)
    low: float | None = None

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the value furthest out of the range."""
        low = -self.high if self.low is None else self.low
        values = self.values([record for record in records if self.name in {**record.errors, **record.readings}])
        furthest = max(values, key=lambda v: np.inf if np.isnan(v) else max(v - self.high, low - v), default=None)
        return self.finding(self.name, furthest, low, self.high)


def each_within(tolerances: dict[str, float], where: dict[str, Any] | None = None,
                low: float | None = None) -> tuple[Within, ...]:
    """Return the expectations that several errors lie within their tolerances."""
    return tuple(Within(name, high, where or {}, low) for name, high in tolerances.items())


@dataclass(frozen=True)
class Order(Expectation):
    """An error falls at least with this power of the resolution between two runs.
    resolution: name of the choice that sets it, whether it grows ("cells") or shrinks ("cell") with refinement. ends:
    its values in the coarse and in the fine run."""

    name: str
    resolution: str
    ends: tuple[float, float]
    least: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the observed order of convergence."""
        (coarse, fine), order = (self.values(records, {self.resolution: end}) for end in self.ends), None
        if coarse and fine:
            order = float(np.log(abs(coarse[0]) / abs(fine[0])) / abs(np.log(self.ends[1] / self.ends[0])))
        return self.finding(f"order of {self.name}, {self.resolution} {self.ends[0]:g} to {self.ends[1]:g}", order,
                            self.least, np.inf)


@dataclass(frozen=True)
class Approach(Expectation):
    """An error falls with every refinement and keeps its sign: one that passes zero has not converged, and fails.
    resolution: name of the choice that sets it. ends: its values, from coarse to fine."""

    name: str
    resolution: str
    ends: tuple[float, ...]
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the ratio of an error to that of the next coarser run which is furthest from the range 0 to 1."""
        errors, found = [self.values(records, {self.resolution: end}) for end in self.ends], None
        if all(errors):
            with np.errstate(divide="ignore", invalid="ignore"):
                found = [float(np.divide(fine, coarse)) for pair in pairwise(errors) for coarse, fine in product(*pair)]
            found = max(found, key=lambda q: np.inf if np.isnan(q) else max(q - 1.0, -q))
        return self.finding(f"ratio of successive {self.name}, {self.resolution} "
                            + ", ".join(f"{end:g}" for end in self.ends), found, 0.0, 1.0)


@dataclass(frozen=True)
class Ratio(Expectation):
    """A reading changes at most by a factor between two values of a choice, from the first to the second."""

    name: str
    resolution: str
    ends: tuple[float | str, float | str]
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the ratio of the means at both ends."""
        first, second = (self.values(records, {self.resolution: end}) for end in self.ends)
        ends = " to ".join(f"{end:g}" if isinstance(end, float) else str(end) for end in self.ends)
        return self.finding(f"ratio of {self.name}, {self.resolution} {ends}",
                            float(np.mean(second) / np.mean(first)) if first and second else None, self.low, self.high)


@dataclass(frozen=True)
class Slope(Expectation):
    """A reading rises along another one by so much per unit: the slope of a straight line through the runs."""

    name: str
    by: str
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, records: Sequence[Record]) -> Finding:
        """Find the slope; of a `Power` not a number where a reading is not positive."""
        x, y = (np.array(self.values(records, name=name)) for name in (self.by, self.name))
        text, found = f"slope of {self.name} over {self.by}", None
        if isinstance(self, Power):
            text = f"power of {self.by} in {self.name}"
            if not (np.all(x > 0) and np.all(y > 0)):
                return self.finding(text, np.nan, self.low, self.high)
            x, y = np.log(x), np.log(y)
        if len(set(x)) > 1:
            found = float(np.polyfit(x, y, 1)[0])
        return self.finding(text, found, self.low, self.high)


class Power(Slope):
    """A reading grows with a power of another one: the slope of a straight line through their logarithms."""


def judge(case: Case, records: Sequence[Record]) -> list[Finding]:
    """Return what runs of a case show for each of its expectations, with units."""
    return [one.evaluate(records)._replace(unit=case.units.get(one.name, "") if isinstance(one, Within) else "")
            for one in case.expectations]

"""What a case claims of its runs, in a form that a report can judge."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from robosim.verification.cases.record import Record


@dataclass(frozen=True)
class Finding:
    """A claim, and what the runs say to it."""

    claim: str
    found: float | None
    """The value furthest from what was claimed; None: no run tells."""
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """pass, fail, or not run."""
        if self.found is None:
            return "not run"
        return "pass" if self.low <= self.found <= self.high else "fail"


def chosen(records: Sequence[Record], where: dict[str, Any]) -> list[Record]:
    """Records whose choices are these."""
    return [record for record in records if all(record.choices.get(key) == value for key, value in where.items())]


def value(record: Record, name: str) -> float:
    """An error of a record, or a reading of that name."""
    return record.errors[name] if name in record.errors else record.readings[name]


def told(where: dict[str, Any]) -> str:
    """Choices in words."""
    return ", ".join(f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}"
                     for key, value in where.items())


@dataclass(frozen=True)
class Within:
    """An error lies within a band in every run with these choices. Without a lower end the band is symmetric."""

    name: str
    high: float
    where: dict[str, Any] = field(default_factory=dict)
    low: float | None = None

    def judge(self, records: Sequence[Record]) -> Finding:
        """The value furthest out."""
        low = -self.high if self.low is None else self.low
        values = [value(record, self.name) for record in chosen(records, self.where)
                  if self.name in record.errors or self.name in record.readings]
        furthest = max(values, key=lambda v: np.inf if np.isnan(v) else max(v - self.high, low - v), default=None)
        claim = self.name + (f" at {told(self.where)}" if self.where else "")
        return Finding(claim, furthest, low, self.high)


@dataclass(frozen=True)
class Order:
    """An error falls at least with this power of the resolution between two runs. finer: what the resolution is told
    by grows ("cells") or shrinks ("cell") as it gets finer."""

    name: str
    knob: str
    ends: tuple[float, float]
    least: float
    where: dict[str, Any] = field(default_factory=dict)

    def judge(self, records: Sequence[Record]) -> Finding:
        """The observed order."""
        errors = [[abs(value(r, self.name)) for r in chosen(records, {**self.where, self.knob: end})]
                  for end in self.ends]
        claim = f"order of {self.name}, {self.knob} {self.ends[0]:g} to {self.ends[1]:g}" \
                + (f" at {told(self.where)}" if self.where else "")
        if not all(errors):
            return Finding(claim, None, self.least, np.inf)
        gained = np.log(errors[0][0] / errors[1][0]) / abs(np.log(self.ends[1] / self.ends[0]))
        return Finding(claim, float(gained), self.least, np.inf)


@dataclass(frozen=True)
class Rising:
    """A reading rises along a choice."""

    name: str
    knob: str
    where: dict[str, Any] = field(default_factory=dict)

    def judge(self, records: Sequence[Record]) -> Finding:
        """The smallest rise from one run to the next."""
        rows = sorted((record.choices[self.knob], value(record, self.name)) for record in chosen(records, self.where))
        smallest = float(np.diff([row[1] for row in rows]).min()) if len(rows) > 1 else None
        return Finding(f"{self.name} rises with {self.knob}", smallest, 1e-6, np.inf)


@dataclass(frozen=True)
class Power:
    """A reading grows with a power of another one, by a straight line through their logarithms."""

    name: str
    by: str
    low: float
    high: float
    where: dict[str, Any] = field(default_factory=dict)

    def judge(self, records: Sequence[Record]) -> Finding:
        """The power."""
        rows = [(value(record, self.by), value(record, self.name)) for record in chosen(records, self.where)]
        claim = f"power of {self.by} in {self.name}" + (f" at {told(self.where)}" if self.where else "")
        if any(not number > 0 for row in rows for number in row):  # a slot that clogs has no power
            return Finding(claim, np.nan, self.low, self.high)
        if len({row[0] for row in rows}) < 2:
            return Finding(claim, None, self.low, self.high)
        x, y = np.log(np.array(rows)).T
        return Finding(claim, float(np.polyfit(x, y, 1)[0]), self.low, self.high)



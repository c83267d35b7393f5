"""Choices of a controller's numbers: where they are searched, and how the next ones are drawn."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from robosim.dosing.numbers import PI_RATES, DosingNumbers

GENERATION = 6
"""Choices that are drawn around the same best one, and may run at the same time."""


class Range(NamedTuple):
    """Where a number is searched."""

    low: float
    high: float
    is_log: bool = True
    """Whether it is drawn on a logarithmic scale."""

    def place(self, value: float) -> float:
        """Return the place of a value in the range, 0 at its low end and 1 at its high end."""
        ends = (self.low, self.high, max(value, self.low))  # a logarithm of a given 0 has no place
        low, high, at = np.log(ends) if self.is_log else ends
        return float(np.clip((at - low) / (high - low), 0.0, 1.0))

    def value(self, place: float) -> float:
        """Return the value at a place, with four digits: what the file of a choice holds."""
        low, high = np.log([self.low, self.high]) if self.is_log else (self.low, self.high)
        at = low + float(np.clip(place, 0.0, 1.0)) * (high - low)
        return float(np.clip(float(f"{np.exp(at) if self.is_log else at:.4g}"), self.low, self.high))


RANGES: dict[str, dict[str, Range]] = {
    "open_loop": {"before_deg": Range(2.0, 30.0), "search_deg": Range(1.0, 20.0), "share": Range(0.5, 1.5),
                  "hold": Range(0.1, 3.0)},
    "pi": {"before_deg": Range(5.0, 40.0), "search_deg": Range(0.5, 6.0), "middle": Range(0.2, 0.9, False),
           "fastest_deg": Range(3.0, 30.0), "time": Range(1.0, 6.0), "least": Range(0.3, 3.0),
           "proportional": Range(0.0, 0.3, False), "integral": Range(0.05, 1.0), "first": Range(0.3, 0.95, False),
           "left": Range(5e-4, 0.01),
           "delay": Range(0.1, 0.6), "window": Range(0.1, 0.4), "stop_deg": Range(2.0, 20.0, False),
           "resume_deg": Range(0.0, 6.0, False), "settle": Range(0.3, 1.2), "resume": Range(0.0, 1.0, False),
           "weakest": Range(0.01, 0.3), "pulse": Range(0.06, 0.4), "pause": Range(0.2, 1.0),
           "next": Range(0.1, 1.0, False), "close": Range(0.2, 1.0, False)},
    "shaker": {"before_deg": Range(2.0, 30.0), "search_deg": Range(1.0, 8.0), "amplitude": Range(0.2, 1.0),
               "time": Range(0.5, 10.0), "ahead": Range(0.02, 0.5), "pulse": Range(0.04, 1.0),
               "settle": Range(0.4, 1.5), "margin": Range(0.1, 0.8, False)},
}
"""Controller -> its numbers with the ranges that they are searched in. The balance's `lag` is known, not searched."""


def draw_choice(controller: str, numbers: DosingNumbers, index: int, seed: int,
                costs: Mapping[int, float], choices: Sequence[DosingNumbers]) -> DosingNumbers:
    """Return the numbers of the choice `index`: the first are those given, later ones lie around the best so far.
    costs: mean cost of each earlier choice that has one, of which those of earlier generations count; so the search is
    the same with any number of processes. Rates of pi go up to `motion.fast_deg`, also where that is below their range.
    choices: the earlier choices' numbers."""
    if index == 0:
        return numbers
    generation = (index - 1) // GENERATION
    known = {k: cost for k, cost in costs.items() if k < 1 + GENERATION * generation}
    best = choices[min(known, key=lambda k: (known[k], k))] if known else numbers
    spread = max(0.05, 0.25 * 0.8**generation)  # standard deviation, as a share of the range
    rng = np.random.default_rng((seed, index))
    own = getattr(best, controller)
    drawn = {name: one.value(one.place(getattr(own, name)) + spread * rng.standard_normal())
             for name, one in RANGES[controller].items()}
    if controller == "pi":
        drawn |= {name: min(drawn[name], best.motion.fast_deg) for name in PI_RATES}
    table = best.model_dump()
    return DosingNumbers.model_validate(table | {controller: table[controller] | drawn})

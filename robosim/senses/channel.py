"""The way of a value from its sensor to the policy: rate, noise, latency and dropout."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from robosim.base.errors import ConfigError
from robosim.senses.term import NOTHING, Sight, Term, check_option

TIMING = ("rate", "latency", "noise", "dropout")
"""Options that every term has besides its own."""
DRAWN_TIMING = {"latency": (0.0, 10.0), "noise": (0.0, 1e6), "dropout": (0.0, 0.999)}
"""Those that episodes may draw, with their lowest and highest values; a latency of 10 s is half an episode."""
ROUNDING = 1e-9
"""Tolerance [s] of times that are sums of steps."""


class Timing(NamedTuple):
    """How a sensor's values reach the policy."""

    rate: float | None = None
    """Values per second; None: one for each action. Between two values the last one is repeated."""
    latency: float = 0.0
    """Age [s] that a value has when it is delivered; the first of an episode is delivered at once."""
    noise: float = 0.0
    """Standard deviation of white noise, in the term's units."""
    dropout: float = 0.0
    """Probability that a value is lost; the one before is repeated."""


def read_timing(term: str, options: dict[str, Any]) -> Timing:
    """Take the options TIMING out of a term's options; raises ConfigError for numbers that cannot be used."""
    rate = options.pop("rate", None)
    return Timing(None if rate is None else check_option(term, "rate", rate, 1e-3, 1e6),
                  *(check_option(term, name, options.pop(name, 0.0), *pair) for name, pair in DRAWN_TIMING.items()))


class Channel:
    """A term with its timing; is_exact: whether values beyond the space's bounds are passed on and not cut there."""

    def __init__(self, term: Term, timing: Timing, is_exact: bool = False) -> None:
        if timing.noise > 0.0 and term.space.dtype == np.uint8:
            raise ConfigError(f"obs: {term.name}: noise = {timing.noise}; accepted: 0, or a term of real numbers")
        self.term, self.space, self.timing, self._is_exact = term, term.space, timing, is_exact

    def begin(self, sight: Sight, drawn: Mapping[str, float] = NOTHING) -> dict[str, Any]:
        """Return the memory of an episode that starts now; drawn: options of timing and term that hold for it."""
        timing = self.timing._replace(**{name: drawn[name] for name in DRAWN_TIMING if name in drawn})
        of_term = {name: value for name, value in drawn.items() if name in self.term.DRAWN}
        return {"term": self.term.begin(sight, of_term), "line": [], "delivered": None, "next": sight.time,
                "timing": timing._asdict()}

    def read(self, sight: Sight, memory: dict[str, Any], rng: np.random.Generator) -> np.ndarray:
        """Return the value that the policy gets now, in an array of its own."""
        timing, line = Timing(**memory["timing"]), memory["line"]
        if sight.time >= memory["next"] - ROUNDING:
            line.append((sight.time, self._measure(sight, memory, timing.noise, rng)))
            memory["next"] = sight.time if timing.rate is None else memory["next"] + 1.0 / timing.rate
        while len(line) > 1 and line[1][0] <= sight.time - timing.latency + ROUNDING:
            line.pop(0)
        lost = timing.dropout > 0.0 and memory["delivered"] is not None and rng.uniform() < timing.dropout
        if not lost:
            memory["delivered"] = line[0][1]
        return np.array(memory["delivered"])

    def _measure(self, sight: Sight, memory: dict[str, Any], noise: float, rng: np.random.Generator) -> np.ndarray:
        value = np.asarray(self.term.measure(sight, memory["term"], rng))
        if noise > 0.0:
            value = value + noise * rng.standard_normal(value.shape)
        if value.dtype != self.space.dtype:
            value = value if self._is_exact else np.clip(value, self.space.low, self.space.high)
            value = value.astype(self.space.dtype)
        return value

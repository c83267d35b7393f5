"""A balance, which lags, drifts, scatters and rounds; and mass and flow of a stream, estimated from what it shows."""

from collections import deque
from typing import Any, NamedTuple

import numpy as np

LEAST_READINGS = 3
"""Readings that a flow is measured with at least."""
Memory = dict[str, Any]
"""What a balance has of its past: "shown", the filtered mass [kg], and "time" [s]; with a drift also "slope" [kg/s]."""


class Stream(NamedTuple):
    """What lies in the cup, and what comes."""

    mass: float
    """Mass in the cup [kg]."""
    flow: float
    """Flow into it [kg/s]."""


class FlowMeter:
    """Line through the balance's readings of the last `window` seconds, by least squares; its slope is the flow.
    lag: time constant [s] of the balance's first-order filter: a steady flow is shown by lag x flow too small."""

    def __init__(self, window: float, lag: float = 0.0) -> None:
        self._window, self._lag = window, lag
        self._readings: deque[tuple[float, float]] = deque()

    def start(self) -> None:
        """Forget all readings."""
        self._readings.clear()

    def add(self, time: float, shown: float) -> Stream:
        """Add a reading [kg] at a time [s]; return mass and flow, the reading and no flow until there are three."""
        self._readings.append((time, shown))
        while self._readings[0][0] < time - self._window:
            self._readings.popleft()
        if len(self._readings) < LEAST_READINGS:
            return Stream(shown, 0.0)
        t, m = np.array(self._readings).T
        middle = t.mean()
        flow = float((t - middle) @ m / ((t - middle) @ (t - middle)))
        return Stream(float(m.mean()) + flow * (time - middle + self._lag), flow)


class Balance(NamedTuple):
    """Numbers of a balance; its past is with the caller, a `Memory` of plain values that `start` begins."""

    lag: float
    """Time constant of its first-order filter [s]; 0: none."""
    readability: float
    """Step of its display [kg]; 0: none."""
    repeatability: float
    """Standard deviation of a reading, before rounding [kg]."""
    drift: float = 0.0
    """Standard deviation of the slope with which its zero moves [kg/s]."""

    @staticmethod
    def start(time: float, mass: float) -> Memory:
        """Return the past of a balance that has settled under a mass [kg] at a time [s]."""
        return {"shown": mass, "time": time}

    def read(self, memory: Memory, time: float, mass: float, rng: np.random.Generator, tare: float = 0.0) -> float:
        """Return what it shows [kg] at a time [s], which does not fall, with a mass [kg] on it, less the tare [kg]."""
        gain = 1.0 if self.lag == 0.0 else 1.0 - np.exp(-(time - memory["time"]) / self.lag)
        memory |= {"shown": memory["shown"] + gain * (mass - memory["shown"]), "time": time}
        shown = memory["shown"] - tare
        if self.drift > 0.0:
            memory.setdefault("slope", self.drift * rng.standard_normal())
            shown += memory["slope"] * time
        if self.repeatability > 0.0:
            shown += self.repeatability * rng.standard_normal()
        if self.readability > 0.0:
            shown = self.readability * np.round(shown / self.readability)
        return float(shown)

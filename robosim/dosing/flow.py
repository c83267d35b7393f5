"""Mass and flow of a stream, estimated from what a balance shows with its lag."""

from collections import deque
from typing import NamedTuple

import numpy as np

LEAST_READINGS = 3
"""Readings that a flow is measured with at least."""


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

"""Flow onto a balance: the slope of what it shows over a window of time."""

from collections import deque

import numpy as np

LEAST_READINGS = 3
"""Readings that a flow is measured with at least."""


class FlowMeter:
    """Slope of the balance's readings over the last `window` seconds, by least squares."""

    def __init__(self, window: float) -> None:
        self._window = window
        self._readings: deque[tuple[float, float]] = deque()

    def start(self) -> None:
        """Forget all readings."""
        self._readings.clear()

    def add(self, time: float, shown: float) -> float:
        """Add a reading [kg] at a time [s]; return the flow [kg/s], zero until there are three readings."""
        self._readings.append((time, shown))
        while self._readings[0][0] < time - self._window:
            self._readings.popleft()
        if len(self._readings) < LEAST_READINGS:
            return 0.0
        t, m = np.array(self._readings).T
        t = t - t.mean()
        return float(t @ m / (t @ t))

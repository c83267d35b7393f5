"""A balance: what it shows lags, scatters, and is rounded to its readability."""

import numpy as np

from robosim.config.motion import BalanceConfig


class Balance:
    """Shows the mass on it less its tare.

    Lag, scatter and rounding are those of `robosim.senses.scale.ScaleTerm`. That one also drifts, and weighs what still
    falls; the mass given here is that in the cup. time [s] and mass [kg]: at which it is tared, at rest.
    """

    def __init__(self, config: BalanceConfig, time: float, mass: float, seed: int = 0) -> None:
        self._config, self._rng = config, np.random.default_rng(seed)
        self._time, self._tare, self._filtered = time, mass, mass

    def read(self, time: float, mass: float) -> float:
        """Return what it shows [kg] at a time [s] with a mass [kg] on it; times do not fall from reading to reading."""
        lag = self._config.lag
        gain = 1.0 if lag == 0.0 else 1.0 - np.exp(-(time - self._time) / lag)
        self._time, self._filtered = time, self._filtered + gain * (mass - self._filtered)
        shown = self._filtered - self._tare + self._config.repeatability * self._rng.standard_normal()
        step = self._config.readability
        return float(step * np.round(shown / step) if step > 0.0 else shown)

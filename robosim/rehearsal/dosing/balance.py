"""The balance under the cup of a dose, tared as the dose begins."""

import numpy as np

from robosim.config.motion import BalanceConfig
from robosim.instruments.balance import Balance


class TaredBalance:
    """Shows the mass on it less its tare.

    `robosim.senses.scale.ScaleTerm` weighs what still falls, too; the mass given here is that in the cup. time [s] and
    mass [kg]: at which it is tared, at rest.
    """

    def __init__(self, config: BalanceConfig, time: float, mass: float, seed: int = 0) -> None:
        self._balance = Balance(config.lag, config.readability, config.repeatability)
        self._memory, self._tare, self._rng = Balance.start(time, mass), mass, np.random.default_rng(seed)

    def read(self, time: float, mass: float) -> float:
        """Return what it shows [kg] at a time [s] with a mass [kg] on it; times do not fall from reading to reading."""
        return self._balance.read(self._memory, time, mass, self._rng, self._tare)

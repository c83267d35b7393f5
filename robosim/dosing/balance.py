"""A balance: what it shows lags, drifts, scatters, and is rounded to its readability."""

from typing import Any, NamedTuple

import numpy as np

Memory = dict[str, Any]
"""What a balance has of its past: "shown", the filtered mass [kg], and "time" [s]; with a drift also "slope" [kg/s]."""


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

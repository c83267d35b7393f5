"""Single pulses of a dose: what is seen when one begins, and factors by which a policy changes it."""

from typing import NamedTuple

import numpy as np

HISTORY = 3
"""Pulses before it that are seen."""
OBSERVED = 7 + 3 * HISTORY
"""Numbers of what is seen."""
CHANGES = 2
"""What is changed of a pulse: its strength and its time."""
LARGEST_MASS = 5.0
"""Largest mass that is seen as such, in units of `PulseSight.observe`; a larger one looks the same."""
LARGEST_FACTOR = 2.0
"""Strength and time of a pulse are changed by up to this factor, or its inverse."""


class Pulse(NamedTuple):
    """A pulse that is over."""

    strength: float
    """Vibration, as a share of the largest."""
    time: float
    """Time [s] for which it was to shake."""
    came: float
    """Mass [kg] that it brought."""


class PulseSight(NamedTuple):
    """What is seen when a pulse begins, as PI control is about to make it."""

    target: float
    """Mass that is wanted in the cup [kg]."""
    accepted: float
    """Error of it that is accepted [kg]."""
    missing: float
    """Mass that is still to come [kg]."""
    flow: float
    """What comes by itself [kg/s]."""
    tilt: float
    """Tilt [rad] past the one at which the pour curve begins."""
    left: float
    """Share of the dose's longest time that is left."""
    strength: float
    """Vibration of the pulse without a change, as a share of the largest."""
    past: tuple[Pulse, ...]
    """Pulses before it in this dose, the last one first, up to HISTORY."""

    def observe(self) -> np.ndarray:
        """Return it as numbers of about 1, (OBSERVED,): masses in 5 accepted errors, no pulse as zeros."""
        unit = 5.0 * max(self.accepted, 1e-6)
        masses = np.array([self.missing, self.flow, *(one.came for one in self.past)]) / unit
        missing, flow, *came = np.clip(masses, -LARGEST_MASS, LARGEST_MASS)
        past = np.zeros((HISTORY, 3))
        for row, one, mass in zip(past, self.past, came, strict=False):
            row[:] = one.strength, one.time, mass
        size = np.log10(max(self.target, 1e-4) / 0.01)
        return np.array([size, unit / max(self.target, unit), missing, flow, self.tilt, self.left, self.strength,
                         *past.ravel()], np.float32)


def pulse_factors(action: np.ndarray) -> tuple[float, float]:
    """Return the factors of a pulse's strength and of its time for an action (CHANGES,) of -1 to 1."""
    strength, time = LARGEST_FACTOR ** np.clip(np.asarray(action, float), -1.0, 1.0)
    return float(strength), float(time)

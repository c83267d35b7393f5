"""What a dosing controller sees and what it commands."""

import math
from typing import NamedTuple, Protocol

import numpy as np

TOLERANCE_PERCENT, TOLERANCE_G = 2.0, 0.3
"""Errors of a dose that are accepted, in % of its target and in g, where no task has its own."""
LEVEL = math.radians(2.0)
"""Tilt [rad] up to which a task counts a tool as level again, which ends its dose."""


class DoseSight(NamedTuple):
    """What a controller sees, at its own rate."""

    time: float
    """Time since the start [s]."""
    shown: float
    """What the balance shows, tared at the start [kg]."""
    target: float
    """Mass that is wanted [kg]."""
    tilt: float
    """The tool's pitch from level [rad], positive as it pours."""
    lip: np.ndarray
    """Lip of the tool in the world [m], shape (3,)."""
    goal: np.ndarray
    """Point above the cup's middle in the world [m], shape (3,): the lip's place while it pours."""


class DoseCommand(NamedTuple):
    """What a controller commands until its next sight."""

    tilt_rate: float
    """Rate of the tool's pitch, about its pitch axis through the lip [rad/s]; positive pours more."""
    velocity: np.ndarray
    """Velocity of the lip in the world [m/s], shape (3,)."""
    amplitude: float
    """Amplitude of the vibration [m]."""
    frequency: float
    """Frequency of the vibration [Hz]."""
    done: bool
    """Whether the dose is finished and the tool is level."""


class DoseController(Protocol):
    """A controller of one dose after another; it knows the balance and the tool's pose, not the grains."""

    def start(self, target: float, accepted: float) -> None:
        """Begin a dose of a mass [kg], of which an error [kg] is accepted; the tool is level and loaded."""

    def command(self, sight: DoseSight) -> DoseCommand:
        """Return the command until the next sight; called once every `control_dt`."""
        ...


def accepted_error(target: float, percent: float = TOLERANCE_PERCENT, grams: float = TOLERANCE_G) -> float:
    """Return the largest error [kg] with which a dose of a target mass [kg] is a success.
    percent, grams: tolerances in % of the target and in g, of which the larger one counts."""
    return max(0.01 * percent * target, 1e-3 * grams)

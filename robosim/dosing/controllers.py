"""Dosing controllers by name."""

import numpy as np

from robosim.base.errors import ConfigError, UnknownName
from robosim.dosing import CONTROLLERS
from robosim.dosing.balance import LEAST_READINGS
from robosim.dosing.command import DoseController
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.open_loop import OpenLoop
from robosim.dosing.pi import PiDosing
from robosim.dosing.shaker import WINDOW, Shaker


def make_controller(name: str, numbers: DosingNumbers, control_dt: float) -> DoseController:
    """Make a controller, one of CONTROLLERS; control_dt: time between two commands [s].
    Raises UnknownName for another name, ConfigError for a time that cannot be used, also where the window over
    which the controller measures the flow has too few readings."""
    kinds = dict(zip(CONTROLLERS, (OpenLoop, PiDosing, Shaker), strict=True))
    if name not in kinds:
        raise UnknownName("controller", name, CONTROLLERS)
    if not 1e-4 <= control_dt <= 0.5:
        raise ConfigError(f"control_dt = {control_dt} s; accepted: 0.0001 to 0.5 s")
    where, window = {"pi": ("pi.window", numbers.pi.window), "shaker": ("window of the shaker", WINDOW)}.get(
        name, ("", np.inf))
    if window < LEAST_READINGS * control_dt * (1.0 - 1e-9):
        raise ConfigError(f"{where} = {window} s with control_dt = {control_dt} s: too few readings to measure the "
                          f"flow; accepted: a window of at least {LEAST_READINGS} x control_dt = "
                          f"{LEAST_READINGS * control_dt:g} s")
    return kinds[name](numbers, control_dt)

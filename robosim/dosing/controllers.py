"""Dosing controllers by name; two of them: in open loop on the pour curve, and by a bang-bang shaker."""

from typing import Literal

import numpy as np

from robosim.base.errors import ConfigError, UnknownName
from robosim.dosing import CONTROLLERS
from robosim.dosing.balance import LEAST_READINGS, FlowMeter
from robosim.dosing.command import DoseCommand, DoseController, DoseSight
from robosim.dosing.motion import ToolMotion
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.pi import PiDosing

WINDOW = 0.3
"""Time [s] over which the flow is measured."""


class Shaker(DoseController):
    """Shakes at full amplitude until the balance shows a mass a little below the target, then in pulses.
    It tilts on while it shakes and little flows. After each pulse it waits for the balance."""

    def __init__(self, numbers: DosingNumbers, control_dt: float) -> None:
        self._numbers, self._curve = numbers.shaker, numbers.curve
        self._amplitude = numbers.shaker.amplitude * numbers.vibration.amplitude
        self._frequency, self._dt = numbers.vibration.frequency, control_dt
        self._motion, self._flow = ToolMotion(numbers.motion, control_dt), FlowMeter(WINDOW)
        self.start(0.0, 0.0)

    def start(self, target: float, accepted: float) -> None:
        self._motion.start()
        self._flow.start()
        self._phase: Literal["approach", "shake", "wait", "back"] = "approach"
        self._aim, self._enough = (1.0 - self._numbers.ahead) * target, self._numbers.margin * accepted
        self._has_stopped, self._since = False, 0.0

    def command(self, sight: DoseSight) -> DoseCommand:
        flow, numbers = self._flow.add(sight.time, sight.shown).flow, self._numbers
        is_enough = sight.target - sight.shown <= self._enough
        if is_enough or self._motion.is_late(sight):
            self._phase = "back"
        if self._phase == "approach":
            return self._approach(sight)
        if self._phase == "shake" and (sight.shown >= self._aim or (
                self._has_stopped and sight.time - self._since >= numbers.pulse)):
            self._phase, self._has_stopped, self._since = "wait", True, sight.time
            self._aim = sight.target - self._enough
        elif self._phase == "wait" and sight.time - self._since >= numbers.settle:
            self._phase, self._since = "shake", sight.time
        if self._phase == "shake":
            is_slow = flow * numbers.time < sight.target - sight.shown
            rate = np.radians(numbers.search_deg) if is_slow else 0.0
            return self._motion.turn(sight, rate, self._amplitude, self._frequency)
        if self._phase == "wait":
            return self._motion.turn(sight, 0.0)
        return self._motion.level(sight)

    def _approach(self, sight: DoseSight) -> DoseCommand:
        if not self._motion.is_near(sight):
            return self._motion.turn(sight, 0.0)
        first = max(0.0, self._curve.begin - np.radians(self._numbers.before_deg))
        if sight.tilt >= first - np.radians(self._numbers.search_deg) * self._dt:
            self._phase, self._since = "shake", sight.time
        return self._motion.turn_to(sight, first)


class OpenLoop(DoseController):
    """Tilts to the angle at which the pour curve gives the target, waits, and tilts back; reads no balance."""

    def __init__(self, numbers: DosingNumbers, control_dt: float) -> None:
        self._numbers, self._curve = numbers.open_loop, numbers.curve
        self._motion, self._dt = ToolMotion(numbers.motion, control_dt), control_dt
        self.start(0.0, 0.0)

    def start(self, target: float, accepted: float) -> None:
        self._motion.start()
        self._tilt = self._curve.tilt(self._numbers.share * target)
        self._slow_from = min(self._tilt, max(0.0, self._curve.begin - np.radians(self._numbers.before_deg)))
        self._reached: float | None = None
        """When the last tilt was reached [s]."""
        self._is_slow = self._is_over = False

    def command(self, sight: DoseSight) -> DoseCommand:
        held = self._reached is not None and sight.time - self._reached >= self._numbers.hold
        self._is_over |= held or self._motion.is_late(sight)
        if self._is_over:
            return self._motion.level(sight)
        if not self._motion.is_near(sight):
            return self._motion.turn(sight, 0.0)
        rest = self._tilt - sight.tilt
        slow = np.radians(self._numbers.search_deg)
        self._is_slow |= sight.tilt >= self._slow_from - slow * self._dt
        if self._reached is None and rest <= 0.5 * slow * self._dt:
            self._reached = sight.time
        if not self._is_slow:
            return self._motion.turn_to(sight, self._slow_from)
        return self._motion.turn(sight, float(np.clip(rest / (2.0 * self._dt), 0.0, slow)))


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

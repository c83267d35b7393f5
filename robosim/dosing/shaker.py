"""Dosing with a bang-bang shaker: a tilt at which little flows by itself, and full vibration or none."""

from typing import Literal

import numpy as np

from robosim.dosing.balance import FlowMeter
from robosim.dosing.command import DoseCommand, DoseController, DoseSight
from robosim.dosing.motion import ToolMotion
from robosim.dosing.numbers import DosingNumbers

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

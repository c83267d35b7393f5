"""Open-loop dosing: the tilt that the pour curve gives for the target."""

import numpy as np

from robosim.dosing.command import DoseCommand, DoseController, DoseSight
from robosim.dosing.motion import ToolMotion
from robosim.dosing.numbers import DosingNumbers


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

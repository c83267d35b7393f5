"""PI control of a dose on what a balance shows, with feed-forward of the pour curve."""

from typing import Literal

import numpy as np

from robosim.dosing.command import DoseCommand, DoseSight
from robosim.dosing.flow import FlowMeter
from robosim.dosing.motion import ToolMotion
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.pour_curve import PourCurve

NOTICED = 2e-4
"""Mass [kg] on the balance by which something flows: a few grains of salt, and 20 steps of a balance of 0.01 g."""
LONGEST_DELAY = 2.0
"""Largest time [s] that a flow is taken to go on after a stop; more is a slab that had not yet come off."""
FALL = 3.0
"""How much faster than it rises the vibration falls, at most."""
AHEAD_SHARE = 0.05
"""Share of the load over which the slope of the pour curve is taken at least."""


class PiDosing:
    """Controls the flow onto the balance by the tilt rate, and shakes where less flows than is wanted.

    The wanted flow is the missing mass divided by a time, which is longer after the first stop. The tilt rate is the
    pour curve's tilt per mass, multiplied by the wanted flow plus a proportional and an integral part of its error; the
    vibration is an integral of it, too. The tool stops where what the balance shows, plus flow x delay, reaches the
    mass aimed at: at first a share of the target, then a share of what is missing. What the balance shows after a stop
    corrects the delay, as batching scales compensate for what is in flight.
    """

    def __init__(self, numbers: DosingNumbers, curve: PourCurve, control_dt: float) -> None:
        self._numbers, self._curve, self._duration = numbers.pi, curve, numbers.motion.duration
        self._vibration, self._dt = numbers.vibration, control_dt
        self._motion, self._flow = ToolMotion(numbers.motion, control_dt), FlowMeter(numbers.pi.window)
        self.start(0.0, 0.0)

    def start(self, target: float, accepted: float) -> None:
        """Begin a dose of a mass [kg], of which an error [kg] is accepted."""
        self._motion.start()
        self._flow.start()
        self._phase: Literal["approach", "pour", "wait", "back"] = "approach"
        self._aim, self._accepted = self._numbers.first * target, accepted
        self._delay, self._summed = self._numbers.delay, 0.0
        self._shown_before = 0.0
        """What the balance showed as the tool began to pour, or to pour again [kg]."""
        self._flows = False
        """Whether anything has flowed yet."""
        self._has_stopped = False
        self._resumes_at = 0.0
        """Tilt [rad] to which it turns as fast as it may after a stop."""
        self._share = 0.0
        """Vibration while it pours, as a share of the largest."""
        self._stop = (0.0, 0.0, 0.0, 0.0)
        """Time [s], mass shown [kg], flow [kg/s] and tilt [rad] at the last stop."""

    def command(self, sight: DoseSight) -> DoseCommand:
        """Return the command until the next sight."""
        flow = self._flow.add(sight.time, sight.shown)
        missing = sight.target - sight.shown
        is_late = sight.time + self._motion.back_time(sight) >= self._duration
        if is_late or (missing <= self._numbers.close * self._accepted and self._phase != "wait"):
            self._phase = "back"
        if self._phase == "approach":
            return self._approach(sight)
        if self._phase == "pour":
            return self._pour(sight, flow)
        if self._phase == "wait":
            return self._wait(sight, flow)
        return self._motion.level(sight)

    def _approach(self, sight: DoseSight) -> DoseCommand:
        """Turn fast to a tilt at which nothing flows yet."""
        if not self._motion.is_near(sight):
            return self._motion.turn(sight, 0.0)
        first = max(0.0, self._curve.begin - np.radians(self._numbers.before_deg))
        if sight.tilt >= first - np.radians(self._numbers.search_deg) * self._dt or sight.shown > NOTICED:
            self._phase, self._shown_before = "pour", sight.shown
        return self._motion.turn_to(sight, first)

    def _pour(self, sight: DoseSight, flow: float) -> DoseCommand:
        """Control the flow, or stop."""
        numbers, missing = self._numbers, sight.target - sight.shown
        if sight.shown + max(flow, 0.0) * self._delay >= self._aim:
            self._phase, self._summed, self._share = "wait", 0.0, numbers.resume * self._share
            self._has_stopped, self._resumes_at = True, sight.tilt - np.radians(numbers.resume_deg)
            self._stop = (sight.time, sight.shown, flow, sight.tilt)
            return self._wait(sight, flow)
        left = self._duration - sight.time - self._motion.back_time(sight) - numbers.settle
        wanted = max(numbers.pace * missing / max(left, numbers.settle), numbers.least * self._accepted)
        if not self._has_stopped:
            wanted = max(wanted, missing / numbers.time)
        lacking = wanted - flow
        per_mass = self._curve.tilt_per_mass(max(sight.shown, 0.0), max(missing, AHEAD_SHARE * self._curve.load))
        fastest, search = np.radians(numbers.fastest_deg), np.radians(numbers.search_deg)
        if not self._flows and sight.shown - self._shown_before >= NOTICED:
            self._flows, self._summed = True, 0.0
        # no integral beyond what the fastest tilt can follow
        most = fastest / max(per_mass * numbers.integral, 1e-9)
        self._summed = float(np.clip(self._summed + lacking * self._dt, 0.0, most))
        rate = per_mass * (wanted + numbers.proportional * lacking + numbers.integral * self._summed)
        if not self._flows:  # the curve does not tell where this material begins
            rate = search
        rate = min(rate, fastest)
        if sight.tilt < self._resumes_at:
            rate = np.radians(numbers.return_deg)
        change = numbers.rise * float(np.clip(lacking / wanted, -FALL, 1.0)) * self._dt
        self._share = float(np.clip(self._share + change, 0.0, numbers.pour_amplitude))
        return self._motion.turn(sight, max(0.0, float(rate)), self._share * self._vibration.amplitude,
                                 self._vibration.frequency)

    def _wait(self, sight: DoseSight, flow: float) -> DoseCommand:
        """Tilt back a little, wait until the balance is at rest, then learn from what still fell."""
        numbers = self._numbers
        time, shown, flow_then, tilt = self._stop
        is_quiet = abs(flow) * numbers.settle < max(NOTICED, 0.25 * self._accepted)
        back = tilt - np.radians(numbers.stop_deg)
        if sight.time - time < numbers.settle:
            return self._motion.turn_to(sight, back)
        if not is_quiet:  # it flows on by itself: tilt back further
            return self._motion.turn(sight, -np.radians(numbers.search_deg))
        fell = sight.shown - shown
        if flow_then > 0.0:
            learned = float(np.clip(fell / flow_then, 0.0, LONGEST_DELAY))
            # too early a stop costs time, too late a one cannot be mended
            self._delay = max(learned, 0.5 * (self._delay + learned))
        missing = sight.target - sight.shown
        self._aim = sight.target - max(numbers.margin * self._accepted, (1.0 - numbers.next) * missing)
        self._phase = "back" if missing <= numbers.close * self._accepted else "pour"
        self._shown_before = sight.shown
        return self._motion.turn(sight, 0.0)

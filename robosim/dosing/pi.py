"""PI control of a dose on what a balance shows: the vibration makes the flow, the tilt follows the pour curve."""

from typing import Literal

import numpy as np

from robosim.dosing.command import DoseCommand, DoseSight
from robosim.dosing.flow import FlowMeter, Stream
from robosim.dosing.motion import ToolMotion
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.pour_curve import PourCurve

NOTICED = 2e-4
"""Mass on the balance [kg] by which something flows: a few grains of salt, and 20 steps of a balance of 0.01 g."""
LONGEST_DELAY = 1.0
"""Longest time [s] that a flow is taken to go on after a stop; more is a slab that had not yet come off."""
LARGEST_EXCESS = 3.0
"""Largest excess of the flow that counts, in wanted flows: the vibration falls that much faster than it rises."""
AHEAD_SHARE = 0.05
"""Share of the load over which the slope of the pour curve is taken at least."""
LEAST_TILT = np.radians(3.0)
"""Tilt [rad] below which it does not go before the end: a tool that is level again has ended its dose."""
NOWHERE = -np.pi
"""Tilt [rad] to return to where there is none."""


class PiDosing:
    """Controls the flow onto the balance by the vibration's amplitude, and stops it ahead of the target.

    At a tilt at which little flows by itself, what is shaken off follows the amplitude at once and stops with it; a
    slide does neither. So the amplitude is a PI control of the flow's relative error, and the tilt follows the pour
    curve with the mass that has left. It tilts on faster where the strongest vibration is not enough, and back where
    material flows without any. The wanted flow is the missing mass divided by a time, longer after the first stop.

    The tool stops where the mass in the cup, plus flow x delay, reaches the mass aimed at: at first a share of the
    target, then a share of what is missing. What still arrives after a stop corrects the delay, as batching scales
    compensate for what is in flight. Mass and flow are estimated from the balance's readings with its known lag.
    """

    def __init__(self, numbers: DosingNumbers, curve: PourCurve, control_dt: float) -> None:
        self._numbers, self._curve, self._duration = numbers.pi, curve, numbers.motion.duration
        self._vibration, self._dt = numbers.vibration, control_dt
        self._motion = ToolMotion(numbers.motion, control_dt)
        self._meter = FlowMeter(numbers.pi.window, numbers.pi.lag)
        self.start(0.0, 0.0)

    def start(self, target: float, accepted: float) -> None:
        """Begin a dose of a mass [kg], of which an error [kg] is accepted."""
        self._motion.start()
        self._meter.start()
        self._phase: Literal["approach", "pour", "wait", "back"] = "approach"
        self._aim, self._accepted = self._numbers.first * target, accepted
        self._delay = self._numbers.delay
        self._share = 0.0
        """Integral part of the vibration, as a share of the largest."""
        self._before = 0.0
        """Mass in the cup as the tool began to pour, or to pour again [kg]."""
        self._flows, self._has_stopped = False, False
        self._resumes_at = NOWHERE
        """Tilt [rad] to which it turns without shaking after a stop."""
        self._stop = (0.0, Stream(0.0, 0.0), 0.0)
        """Time [s], stream and tilt [rad] at the last stop."""

    def command(self, sight: DoseSight) -> DoseCommand:
        """Return the command until the next sight."""
        stream = self._meter.add(sight.time, sight.shown)
        is_late = sight.time + self._motion.back_time(sight) >= self._duration
        is_enough = sight.target - sight.shown <= self._numbers.close * self._accepted
        if is_late or (is_enough and self._phase != "wait"):
            self._phase = "back"
        if self._phase == "approach":
            return self._approach(sight)
        if self._phase == "pour":
            return self._pour(sight, stream)
        if self._phase == "wait":
            return self._wait(sight, stream)
        return self._motion.level(sight)

    def _approach(self, sight: DoseSight) -> DoseCommand:
        """Turn fast to a tilt at which nothing flows yet."""
        if not self._motion.is_near(sight):
            return self._motion.turn(sight, 0.0)
        first = max(LEAST_TILT, self._curve.begin - np.radians(self._numbers.before_deg))
        if sight.tilt >= first - np.radians(self._numbers.search_deg) * self._dt or sight.shown > NOTICED:
            self._phase, self._before = "pour", sight.shown
        return self._motion.turn_to(sight, first)

    def _pour(self, sight: DoseSight, stream: Stream) -> DoseCommand:
        """Control the flow, or stop."""
        numbers = self._numbers
        if stream.mass + max(stream.flow, 0.0) * self._delay >= self._aim:
            self._phase, self._share = "wait", numbers.resume * self._share
            self._has_stopped, self._resumes_at = True, sight.tilt - np.radians(numbers.resume_deg)
            self._stop = (sight.time, stream, sight.tilt)
            return self._wait(sight, stream)
        if sight.tilt < self._resumes_at:
            return self._motion.turn(sight, np.radians(numbers.return_deg))
        self._resumes_at = NOWHERE
        self._flows = self._flows or stream.mass - self._before >= NOTICED
        missing = sight.target - stream.mass
        lacking = self._lacking(sight, stream, missing)
        self._share = float(np.clip(self._share + numbers.integral * lacking * self._dt, 0.0, 1.0))
        share = float(np.clip(self._share + numbers.proportional * lacking, 0.0, 1.0))
        search = np.radians(numbers.search_deg)
        if not self._flows:  # the curve does not tell where this material begins
            rate = search
        else:
            ahead = max(missing, AHEAD_SHARE * self._curve.load)
            rate = self._curve.tilt_per_mass(max(stream.mass, 0.0), ahead) * max(stream.flow, 0.0)
            if share == 1.0 or share == 0.0:
                rate += search * lacking
        fastest = np.radians(numbers.fastest_deg)
        if sight.tilt <= LEAST_TILT:
            rate = max(rate, 0.0)
        return self._motion.turn(sight, float(np.clip(rate, -fastest, fastest)), share * self._vibration.amplitude,
                                 self._vibration.frequency)

    def _lacking(self, sight: DoseSight, stream: Stream, missing: float) -> float:
        """Return what the flow lacks of the wanted one, as a share of it: 1 where nothing flows."""
        numbers = self._numbers
        left = self._duration - sight.time - self._motion.back_time(sight) - numbers.settle
        wanted = max(numbers.pace * missing / max(left, numbers.settle), numbers.least * self._accepted)
        if not self._has_stopped:
            wanted = max(wanted, missing / numbers.time)
        return float(np.clip((wanted - stream.flow) / wanted, -LARGEST_EXCESS, 1.0))

    def _wait(self, sight: DoseSight, stream: Stream) -> DoseCommand:
        """Tilt back a little, wait until the balance is at rest, then learn from what still fell."""
        numbers = self._numbers
        time, then, tilt = self._stop
        if sight.time - time < numbers.settle:
            return self._motion.turn_to(sight, max(LEAST_TILT, tilt - np.radians(numbers.stop_deg)))
        if abs(stream.flow) * numbers.settle >= max(NOTICED, 0.25 * self._accepted):  # it flows on by itself
            further = np.radians(numbers.return_deg) * numbers.window
            return self._motion.turn_to(sight, max(LEAST_TILT, sight.tilt - further))
        if then.flow > 0.0:
            learned = float(np.clip((stream.mass - then.mass) / then.flow, 0.0, LONGEST_DELAY))
            # too early a stop costs time, too late a one cannot be mended
            self._delay = max(learned, 0.5 * (self._delay + learned))
        missing = sight.target - sight.shown
        self._aim = sight.target - max(numbers.margin * self._accepted, (1.0 - numbers.next) * missing)
        self._phase = "back" if missing <= numbers.close * self._accepted else "pour"
        self._before = sight.shown
        return self._motion.turn(sight, 0.0)

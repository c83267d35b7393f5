"""PI control of a dose on what a balance shows: the vibration makes the flow, the tilt follows the pour curve."""

from collections.abc import Callable

import numpy as np

from robosim.dosing.balance import FlowMeter, Stream
from robosim.dosing.command import LEVEL, DoseCommand, DoseController, DoseSight
from robosim.dosing.motion import ToolMotion
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.pulses import HISTORY, Pulse, PulseSight

NOTICED = 2e-4
"""Mass on the balance [kg] by which something flows: a few grains of salt, and 20 steps of a balance of 0.01 g."""
LARGEST_EXCESS = 3.0
"""Largest excess of the flow that counts, in wanted flows: the vibration falls that much faster than it rises."""
WEAKER, STRONGER = 0.5, 1.2
"""Least and largest factor of the vibration from one pulse to the next."""
LEAST_PULSE = 0.4
"""Least mass that a pulse is to bring, in accepted errors."""
AHEAD_SHARE = 0.05
"""Share of the load over which the slope of the pour curve is taken at least."""
LEAST_TILT = 1.5 * LEVEL
"""Tilt [rad] below which it does not go before the end: a tool that is level again has ended its dose."""
PULSE_RATE = 0.1
"""Largest tilt rate [rad/s] during pulses, which only follow their tilt."""


class PiDosing(DoseController):
    """Doses in two stages, as batching scales do: a controlled flow up to a share of the target, then single pulses.

    At a tilt at which little flows by itself, what is shaken off follows the amplitude at once and stops with it; a
    slide does neither. So the amplitude is a PI control of the flow's relative error, and the tilt follows the pour
    curve with the mass that has left. It tilts on where the vibration is stronger than half (mid-ranging control), and
    back where material flows without any. The first stage stops where the mass in the cup, plus flow x delay, reaches
    its share. In the second it shakes for the time of a pulse, waits until the balance shows what came, and makes the
    next pulse stronger or weaker, so that each brings a share of what is missing. A policy may change each pulse as it
    begins: `pulse` and `change`."""

    def __init__(self, numbers: DosingNumbers, control_dt: float) -> None:
        self._numbers, self._curve = numbers.pi, numbers.curve
        self._vibration, self._dt = numbers.vibration, control_dt
        self._motion, self._duration = ToolMotion(numbers.motion, control_dt), numbers.motion.duration
        self._meter = FlowMeter(numbers.pi.window, numbers.pi.lag)
        self.start(0.0, 0.0)

    def start(self, target: float, accepted: float) -> None:
        self._motion.start()
        self._meter.start()
        self._phase: Callable[[DoseSight, Stream], DoseCommand] = self._approach
        self._accepted = accepted
        self._share = 0.0
        """Vibration, as a share of the largest: its integral part in the first stage."""
        self._flows = False
        self._at = 0.0
        """Time [s] at which it stopped, or at which the pulse began."""
        self._tilt = 0.0
        """Tilt [rad] at which it shakes in the second stage."""
        self._before = 0.0
        """Mass in the cup before the pulse [kg]."""
        self.pulse: PulseSight | None = None
        """The pulse that the last command begins; None where it begins none."""
        self._past: tuple[Pulse, ...] = ()
        self._time = 0.0
        """For how long the pulse shakes at most [s]; 0 before the first."""
        self._acted = 0.0
        """Vibration with which it shakes, as a share of the largest."""

    def change(self, stronger: float, longer: float) -> None:
        """Change vibration and time of the pulse that the last command began, by factors, from the next command on.
        Its vibration stays within the weakest and the strongest; the next pulse follows from what acted."""
        self._share = float(np.clip(stronger * self._share, self._numbers.weakest, 1.0))
        self._time *= longer

    def command(self, sight: DoseSight) -> DoseCommand:
        stream, self.pulse = self._meter.add(sight.time, sight.shown), None
        is_enough = sight.target - sight.shown <= self._numbers.close * self._accepted
        if is_enough or self._motion.is_late(sight):
            self._phase = lambda sight, stream: self._motion.level(sight)
        return self._phase(sight, stream)

    def _approach(self, sight: DoseSight, stream: Stream) -> DoseCommand:
        if not self._motion.is_near(sight):
            return self._motion.turn(sight, 0.0)
        first = max(LEAST_TILT, self._curve.begin - np.radians(self._numbers.before_deg))
        if sight.tilt >= first - np.radians(self._numbers.search_deg) * self._dt or sight.shown > NOTICED:
            self._phase = self._pour
        return self._motion.turn_to(sight, first)

    def _pour(self, sight: DoseSight, stream: Stream) -> DoseCommand:
        numbers = self._numbers
        enough = min(numbers.first * sight.target, sight.target - numbers.left)
        if enough <= 0.0:  # no more than pulses are to bring
            self._phase, self._tilt = self._pulse, max(LEAST_TILT, sight.tilt)
            self._begin(sight, stream, self._before)
            return self._pulse(sight, stream)
        if self._coming(stream) >= enough:
            return self._stop(sight, stream, numbers.resume * self._share)
        self._flows = self._flows or stream.mass >= NOTICED
        missing = sight.target - stream.mass
        wanted = max(missing / numbers.time, numbers.least * self._accepted)
        lacking = float(np.clip((wanted - stream.flow) / wanted, -LARGEST_EXCESS, 1.0))
        self._share = float(np.clip(self._share + numbers.integral * lacking * self._dt, 0.0, 1.0))
        share = float(np.clip(self._share + numbers.proportional * lacking, 0.0, 1.0))
        search = np.radians(numbers.search_deg)
        if not self._flows:  # the curve does not tell where this material begins
            rate = search
        else:
            ahead = max(missing, AHEAD_SHARE * self._curve.load)
            rate = self._curve.tilt_per_mass(max(stream.mass, 0.0), ahead) * max(stream.flow, 0.0)
            rate += search * (lacking if share == 0.0 else self._beyond_middle(share))
        fastest = np.radians(numbers.fastest_deg)
        rate = float(np.clip(rate, 0.0 if sight.tilt <= LEAST_TILT else -fastest, fastest))
        return self._motion.turn(sight, rate, share * self._vibration.amplitude, self._vibration.frequency)

    def _stop(self, sight: DoseSight, stream: Stream, share: float) -> DoseCommand:
        """Stop what flows; share: vibration of the next pulse."""
        self._phase, self._at, self._share = self._wait, sight.time, share
        self._tilt = max(LEAST_TILT, sight.tilt - np.radians(self._numbers.resume_deg))
        return self._wait(sight, stream)

    def _wait(self, sight: DoseSight, stream: Stream) -> DoseCommand:
        """Tilt back, wait until the balance is at rest, and turn to where it shakes again."""
        numbers = self._numbers
        waited = sight.time - self._at
        if waited < numbers.settle:
            return self._motion.turn_to(sight, max(LEAST_TILT, self._tilt - np.radians(numbers.stop_deg)))
        if sight.tilt < self._tilt - np.radians(numbers.search_deg) * self._dt:
            return self._motion.turn_to(sight, self._tilt)
        self._phase = self._pulse
        self._begin(sight, stream, stream.mass)
        return self._pulse(sight, stream)

    def _begin(self, sight: DoseSight, stream: Stream, before: float) -> None:
        """Begin a pulse; before: mass in the cup [kg] that what it brings is counted from."""
        if self._time > 0.0:
            self._past = (Pulse(self._acted, self._time, max(before - self._before, 0.0)), *self._past)[:HISTORY]
        self._at, self._before, self._time = sight.time, before, self._numbers.pulse
        self.pulse = PulseSight(
            sight.target, self._accepted, sight.target - before, max(stream.flow, 0.0),
            sight.tilt - self._curve.begin, 1.0 - sight.time / self._duration,
            max(self._share, self._numbers.weakest), self._past)

    def _pulse(self, sight: DoseSight, stream: Stream) -> DoseCommand:
        """Shake for the time of a pulse, wait for the balance, learn from what came."""
        numbers = self._numbers
        passed = sight.time - self._at
        wanted = max(numbers.next * (sight.target - self._before), LEAST_PULSE * self._accepted)
        self._acted = max(self._share, numbers.weakest)
        if passed >= self._time + numbers.pause:
            came = max(stream.mass - self._before, 0.0)
            factor = float(np.clip(np.sqrt(wanted / max(came, 1e-9)), WEAKER, STRONGER))
            if came < wanted:
                self._tilt += np.radians(numbers.search_deg) * passed * self._beyond_middle(self._share)
            self._share = float(np.clip(factor * self._acted, 0.0, 1.0))
            # `wanted` stays the last pulse's for this one command: the measured doses were made so
            self._begin(sight, stream, stream.mass)
            passed = 0.0
        coming = self._coming(stream)
        if coming >= sight.target and passed >= self._time:  # it flows on by itself
            return self._stop(sight, stream, WEAKER * self._share)
        is_over = passed >= self._time or coming >= self._before + wanted
        share = 0.0 if is_over else max(self._share, numbers.weakest)
        return self._motion.turn_to(sight, self._tilt, share * self._vibration.amplitude, self._vibration.frequency,
                                    PULSE_RATE)

    def _coming(self, stream: Stream) -> float:
        """Return what will lie in the cup [kg] if the vibration stops now."""
        return stream.mass + max(stream.flow, 0.0) * self._numbers.delay

    def _beyond_middle(self, share: float) -> float:
        """By how much a vibration is stronger than the middle, 1 for the strongest."""
        middle = self._numbers.middle
        return max(0.0, (share - middle) / (1.0 - middle))


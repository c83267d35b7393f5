"""Motion of a dosing tool: tilt rates that change smoothly, the way of the lip to its place, and vibration."""

import math

import numpy as np

import mpm
from robosim.dosing.command import LEVEL, DoseCommand, DoseSight
from robosim.dosing.numbers import MotionNumbers

BACK = 0.5 * LEVEL
"""Tilt [rad] up to which the tool is back at the end, well within what a task counts as level."""
RESPONSE = 0.05
"""Time constant [s] with which a vibration's amplitude follows the command: a stop at once knocks grains off."""
STILL = 1e-7
"""Amplitude [m] below which nothing vibrates."""


class ToolMotion:
    """Makes commands of wanted tilt rates, one every `control_dt` [s]; keeps the tilt rate of the last one."""

    def __init__(self, numbers: MotionNumbers, control_dt: float) -> None:
        self._numbers, self._dt = numbers, control_dt
        self._change, self._rate = np.radians(numbers.acceleration_deg) * control_dt, 0.0
        self._fast = np.radians(numbers.fast_deg)

    def start(self) -> None:
        """Begin a dose at rest."""
        self._rate = 0.0

    def is_near(self, sight: DoseSight) -> bool:
        """Return whether the lip is above the cup's middle."""
        return float(np.hypot(*(sight.goal - sight.lip)[:2])) <= self._numbers.near

    def is_late(self, sight: DoseSight) -> bool:
        """Return whether the time left is what it takes to tilt back to level, with the acceleration at both ends."""
        back = abs(sight.tilt) / self._fast + 2.0 * self._fast / np.radians(self._numbers.acceleration_deg)
        return sight.time + back >= self._numbers.duration

    def turn_to(self, sight: DoseSight, tilt: float, amplitude: float = 0.0, frequency: float = 0.0,
                fastest: float = np.inf) -> DoseCommand:
        """Turn to a tilt [rad] and stop there, fast or at most with a rate [rad/s]; shake as `turn` does."""
        rest = tilt - sight.tilt
        # the rate from which the remaining angle is enough to brake, one interval later
        braking = np.sqrt(2.0 * np.radians(self._numbers.acceleration_deg) * abs(rest))
        rate = min(self._fast, fastest, braking, abs(rest) / (2.0 * self._dt))
        return self.turn(sight, float(np.sign(rest) * rate), amplitude, frequency)

    def turn(self, sight: DoseSight, rate: float, amplitude: float = 0.0, frequency: float = 0.0) -> DoseCommand:
        """Turn with a rate [rad/s], or the nearest that can be reached; shake with an amplitude [m] and frequency."""
        self._rate += float(np.clip(rate - self._rate, -self._change, self._change))
        velocity = (sight.goal - sight.lip) / self._numbers.approach_time
        speed = float(np.linalg.norm(velocity))
        if speed > self._numbers.approach_speed:
            velocity = velocity * (self._numbers.approach_speed / speed)
        return DoseCommand(self._rate, velocity, amplitude, frequency, False)

    def level(self, sight: DoseSight) -> DoseCommand:
        """Turn back to level; the command is done once it is."""
        return self.turn_to(sight, 0.0)._replace(done=sight.tilt <= BACK)


class Vibration:
    """A sine along an axis of the tool's frame, whose amplitude [m] follows the command with RESPONSE."""

    def __init__(self, axis: str) -> None:
        self._axis = "xyz".index(axis)
        self.restart()

    def restart(self) -> None:
        """Begin at rest."""
        self.amplitude = self.phase = 0.0

    def state(self) -> tuple[float, float]:
        """Return amplitude [m] and phase [rad]."""
        return self.amplitude, self.phase

    def load(self, state: tuple[float, float]) -> None:
        """Take over what `state` returned."""
        self.amplitude, self.phase = map(float, state)

    def shake(self, pose: mpm.Pose, dt: float, amplitude: float, frequency: float) -> mpm.Pose:
        """Advance by dt [s] under a command [m], [Hz]; return a pose displaced by the vibration at its end."""
        self.amplitude += (1.0 - math.exp(-dt / RESPONSE)) * (amplitude - self.amplitude)
        if amplitude == 0.0 and self.amplitude < STILL:
            self.restart()
            return pose
        self.phase = math.fmod(self.phase + 2.0 * math.pi * frequency * dt, 2.0 * math.pi)
        offset: np.ndarray = self.amplitude * math.sin(self.phase) * pose.matrix[:, self._axis]
        return mpm.Pose(pose.position + offset, pose.quaternion)

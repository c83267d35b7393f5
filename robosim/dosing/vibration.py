"""The vibration that helps grains to flow."""

import math

import numpy as np

import mpm

RESPONSE = 0.05
"""Time constant [s] with which a vibration's amplitude follows the command: a stop at once knocks grains off."""
STILL = 1e-7
"""Amplitude [m] below which nothing vibrates."""


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

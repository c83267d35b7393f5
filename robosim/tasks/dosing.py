"""Dosing: the vibration that helps grains to flow, and the largest mass that a task can give."""

import math

import numpy as np

import mpm
from robosim.shapes import tool_shape
from robosim.tasks.task import TaskConfig

TARGET_MASS = "target_mass"
"""Name of the mass to dose among the numbers that an episode draws."""
RESPONSE = 0.05
"""Time constant [s] with which a vibration's amplitude follows the command: a stop at once knocks grains off."""
STILL = 1e-7
"""Amplitude [m] below which nothing vibrates."""


class Vibration:
    """A sine along an axis of the tool's frame, whose amplitude follows the command with RESPONSE."""

    def __init__(self, task: TaskConfig) -> None:
        assert task.action.vibration is not None
        self._dt, self._axis = task.step_dt, "xyz".index(task.action.vibration.axis)
        self.restart()

    def restart(self) -> None:
        """Begin an episode at rest."""
        self.amplitude = self.phase = 0.0

    def state(self) -> tuple[float, float]:
        """Return amplitude [m] and phase [rad]."""
        return self.amplitude, self.phase

    def load(self, state: tuple[float, float]) -> None:
        """Take over what `state` returned."""
        self.amplitude, self.phase = map(float, state)

    def shake(self, pose: mpm.Pose, amplitude: float, frequency: float) -> mpm.Pose:
        """Advance by a step under a command [m], [Hz]; return a pose displaced by the vibration at its end."""
        self.amplitude += (1.0 - math.exp(-self._dt / RESPONSE)) * (amplitude - self.amplitude)
        if amplitude == 0.0 and self.amplitude < STILL:
            self.amplitude = self.phase = 0.0
            return pose
        self.phase = math.fmod(self.phase + 2.0 * math.pi * frequency * self._dt, 2.0 * math.pi)
        offset: np.ndarray = self.amplitude * math.sin(self.phase) * pose.matrix[:, self._axis]
        return mpm.Pose(pose.position + offset, pose.quaternion)


def load_mass(task: TaskConfig, density: float, volume: float) -> tuple[float, str]:
    """Return the largest mass [kg] that a dosing task can give, and what it is in words.

    density: of the material [kg/m^3]. volume: of one grain [m^3]. A tool that begins empty is filled level with its
    rim at most; a heap above it does not count.
    """
    total = task.grains.count * volume * density
    if task.carried:
        return total, f"the {task.tool_name} holds"
    return min(total, tool_shape(task.tool).capacity * density), f"the {task.tool_name} has room for"

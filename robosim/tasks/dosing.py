"""Dosing: reward, readings and end of an episode, and the vibration that helps grains to flow.

Masses are in kg. What is poured is the mass in the receiver; in a task without one, the mass in the tool.
"""

import math
from typing import NamedTuple

import numpy as np

import mpm
from robosim.dosing.command import LEVEL, accepted_error
from robosim.shapes import tool_shape
from robosim.tasks.counting import TaskCounts
from robosim.tasks.reward import EpisodeSums
from robosim.tasks.task import TaskConfig

TARGET_MASS = "target_mass"
"""Name of the mass to dose among the numbers that an episode draws."""
TILTED = math.radians(5.0)
"""Tilt [rad] from which a tool counts as tilted."""
REST = 0.5
"""Time [s] for which a tool is level until the episode ends: what has left it falls into the receiver meanwhile."""
CLEAR = 0.02
"""Distance [m] from a container from which a tool counts as out of it."""
WORST_ERROR = 2.0
"""Largest error that the reward tells from a smaller one, as a share of the target."""
RESPONSE = 0.05
"""Time constant [s] with which a vibration's amplitude follows the command: a stop at once knocks grains off."""
STILL = 1e-7
"""Amplitude [m] below which nothing vibrates."""


class DoseReward(EpisodeSums):
    """Reward terms, readings and end of a dosing episode; methods as of `robosim.tasks.reward.Reward`."""

    SUMS = ("score", "target", "grain_mass", "error", "spilled", "steps", "has_tilted", "level_steps", "most")

    def __init__(self, task: TaskConfig) -> None:
        assert task.dose is not None
        self.task, self.dose = task, task.dose
        self.terms = task.terms
        self.counted = self.observed = task.grains.count
        level = task.start.pitch_deg if self.dose.level_pitch_deg is None else self.dose.level_pitch_deg
        self._up = task.start.model_copy(update={"pitch_deg": level}).pose.matrix[2]
        """Axis of the tool's frame that is vertical while the tool is level."""
        self._start_tilt = self.tilt(task.start.pose)
        self.restart()

    def restart(self, target: float = math.inf, grain_mass: float = 0.0) -> None:
        """Begin a new episode with a target [kg]; grain_mass: of one material point [kg]."""
        self.target, self.grain_mass = target, grain_mass
        self.score = dict.fromkeys(self.terms, 0.0)
        self.error, self.spilled = 1.0, 0.0
        """Size of the error, up to WORST_ERROR, and spilled mass, up to 1, as shares of the target."""
        self.steps, self.has_tilted, self.level_steps, self.most = 0, self._start_tilt > TILTED, 0, 0.0

    @property
    def is_over(self) -> bool:
        """Whether the tool was tilted, and has been level and out of the container for REST since."""
        return self.level_steps * self.task.step_dt > REST - 1e-9

    def tilt(self, pose: mpm.Pose) -> float:
        """Return the angle [rad] between the vertical and the axis that is vertical while the tool is level."""
        x, y, z = pose.matrix @ self._up
        return math.atan2(math.hypot(x, y), z)

    def step(self, counts: TaskCounts, angle: float, last: bool) -> dict[str, float]:
        """Return the terms of one step and add them to the score.

        angle [rad]: `tilt` of the tool. last: whether the episode ends here.
        """
        self.has_tilted |= angle > TILTED
        is_level = self.has_tilted and angle <= LEVEL and (self.task.container is None or counts.clearance >= CLEAR)
        self.steps, self.level_steps = self.steps + 1, self.level_steps + 1 if is_level else 0
        masses, weights = self.masses(counts), self.dose.reward
        self.most = max(self.most, masses.poured)
        error = min(abs(masses.poured / self.target - 1.0), WORST_ERROR)
        spilled = min(masses.spilled / self.target, 1.0)
        values = {"error": weights.error * (self.error - error), "time": -weights.time / self.task.steps,
                  "spill": weights.spill * (self.spilled - spilled)}
        self.error, self.spilled = error, spilled
        self.add_to_score(values)
        return values

    def diverge(self, steps_left: int) -> dict[str, float]:
        """Return the terms of an episode whose simulation diverged, the worst there are, and add them to the score."""
        weights = self.dose.reward
        worst = {"error": weights.error * (self.error - WORST_ERROR),
                 "time": -weights.time * steps_left / self.task.steps, "spill": weights.spill * (self.spilled - 1.0)}
        self.error, self.spilled = WORST_ERROR, 1.0
        self.add_to_score(worst)
        return worst

    def masses(self, counts: TaskCounts) -> "Masses":
        """Return where the grains are, by their mass."""
        if self.task.receiver is None:
            return Masses(*(self.grain_mass * n for n in (
                counts.held, counts.lost, counts.held, self.counted - counts.held - counts.lost)))
        spilled = max(counts.lost - counts.on_target, 0)
        falling = max(self.counted - counts.held - counts.on_target - spilled, 0)
        return Masses(*(self.grain_mass * n for n in (counts.on_target, spilled, counts.held, falling)))

    def readings(self, counts: TaskCounts) -> dict[str, float]:
        """Return the dose: masses [kg], the error in kg and in % of the target, and the time [s].

        overshoot: by how much the mass has been above the target. held, elsewhere: masses in the tool, and neither
        there nor poured nor spilled.
        """
        masses = self.masses(counts)
        error = masses.poured - self.target
        return {"poured": masses.poured, TARGET_MASS: self.target, "dose_error": error,
                "dose_error_percent": 100.0 * error / self.target, "overshoot": max(self.most - self.target, 0.0),
                "seconds": self.steps * self.task.step_dt, "spilled": masses.spilled, "held": masses.held,
                "elsewhere": masses.elsewhere}

    def is_success(self, counts: TaskCounts) -> bool:
        """Return whether the mass is right to within the larger one of the task's two tolerances."""
        allowed = accepted_error(self.target, self.dose.tolerance_percent, self.dose.tolerance_g)
        return bool(abs(self.masses(counts).poured - self.target) <= allowed)

    def extremes(self) -> tuple[float, float]:
        """Return the score of a tool that never moves, and that of an exact dose in no time."""
        return -self.dose.reward.time, self.dose.reward.error


class Masses(NamedTuple):
    """Where the grains of a dosing task are [kg]; the sum is the load."""

    poured: float
    """In the receiver; in a task without one, in the tool."""
    spilled: float
    """Beside the receiver, below its rim; in a task without one, outside the bounds."""
    held: float
    """In the tool."""
    elsewhere: float
    """In the air, or in the container."""


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

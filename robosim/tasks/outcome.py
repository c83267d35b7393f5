"""How far an episode has come, by its grains or by the dosed mass: readings, success, and an end before its time.
Masses are in kg. What is poured is the mass in the receiver; in a task without one, the mass in the tool."""

import copy
import math
from typing import Any, ClassVar

import numpy as np

import mpm
from robosim.dosing.command import LEVEL, accepted_error
from robosim.rewards.reward import Reward
from robosim.rewards.term import RewardScene, Step
from robosim.shapes import tool_shape
from robosim.tasks.sections import TARGET_MASS
from robosim.tasks.task import TaskConfig

TILTED = math.radians(5.0)
"""Tilt [rad] from which a tool counts as tilted."""
REST = 0.5
"""Time [s] for which a tool is level until the episode ends: what has left it falls into the receiver meanwhile."""
CLEAR = 0.02
"""Distance [m] from a container from which a tool counts as out of it."""


class Outcome:
    """What an episode is measured by, besides its reward: grains on the target, lost, and in the tool."""

    STATE: ClassVar[tuple[str, ...]] = ("on_target", "poured_on_target")
    """Attributes that the steps of an episode change."""
    is_over: bool = False
    """Whether the episode ends before its time."""

    def __init__(self, task: TaskConfig) -> None:
        self.task = task
        self.restart(math.inf, 0.0)

    def state(self) -> dict[str, Any]:
        """Return the numbers of the episode so far."""
        return {name: copy.copy(getattr(self, name)) for name in self.STATE}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        for name, value in [(name, copy.copy(state[name])) for name in self.STATE]:
            setattr(self, name, value)

    def restart(self, target: float, grain_mass: float) -> None:
        """Begin a new episode; target: mass to dose [kg]. grain_mass: of one material point [kg]."""
        self.on_target, self.poured_on_target = 0, 0

    def step(self, counts: mpm.Counts, pose: mpm.Pose, rotation: float, last: bool) -> Step:
        """Return what the terms of the reward are computed from, also which grains closest to the goal count.
        pose: of the tool. rotation [rad]: of it about its lateral axis since the start."""
        distance, self.on_target = counts.distance, counts.in_region
        if counts.per_particle is not None:
            distances, on_target = counts.per_particle.T
            counted = self.task.grains.counted
            nearest = np.argpartition(distances, counted - 1)[:counted]
            distance, self.on_target = float(distances[nearest].sum(dtype=float)), int(on_target[nearest].sum())
        self.poured_on_target += counts.exited_from_region
        return Step(counts, distance, self.on_target, rotation, last)

    def readings(self, counts: mpm.Counts) -> dict[str, float]:
        """Return physical readings that do not depend on the weights.
        delivered, retained: shares of the counted grains; spilled: share of the observed grains."""
        task, n = self.task, self.task.grains.counted
        pours, observed = "poured" in task.reward, task.grains.count // task.grains.observe_every
        return {"delivered": (self.poured_on_target if pours else self.on_target) / n,
                "spilled": (counts.exited - self.poured_on_target if pours else counts.exited) / observed,
                "retained": min(counts.in_inner / n, 1.0) if task.grains.elites else counts.in_inner / n}

    def is_success(self, counts: mpm.Counts, readings: dict[str, float]) -> bool:
        """Return whether the present state is a success; readings: all of them, those of reward terms too."""
        success = self.task.success
        assert success is not None
        is_level = success.turn_error_deg is None or readings["turn_error_deg"] <= success.turn_error_deg
        return bool(readings["delivered"] >= success.delivered and is_level)


class Dose(Outcome):
    """The dosed mass; the episode ends when the tool is level again and what it has poured has fallen."""

    STATE = ("target", "grain_mass", "steps", "has_tilted", "level_steps", "most")

    def __init__(self, task: TaskConfig) -> None:
        assert task.dose is not None
        self.dose = task.dose
        level = task.start.pitch_deg if self.dose.level_pitch_deg is None else self.dose.level_pitch_deg
        self._up = task.start.model_copy(update={"pitch_deg": level}).pose.matrix[2]
        """Axis of the tool's frame that is vertical while the tool is level."""
        self._start_tilt = self.tilt(task.start.pose)
        super().__init__(task)

    def restart(self, target: float, grain_mass: float) -> None:
        self.target, self.grain_mass = target, grain_mass
        self.steps, self.has_tilted, self.level_steps, self.most = 0, self._start_tilt > TILTED, 0, 0.0

    @property
    def is_over(self) -> bool:
        """Whether the tool was tilted, and has been level and out of the container for REST since."""
        return self.level_steps * self.task.step_dt > REST - 1e-9

    def tilt(self, pose: mpm.Pose) -> float:
        """Return the angle [rad] between the vertical and the axis that is vertical while the tool is level."""
        x, y, z = pose.matrix @ self._up
        return math.atan2(math.hypot(x, y), z)

    def step(self, counts: mpm.Counts, pose: mpm.Pose, rotation: float, last: bool) -> Step:
        angle = self.tilt(pose)
        self.has_tilted |= angle > TILTED
        is_level = self.has_tilted and angle <= LEVEL and (self.task.container is None or counts.clearance >= CLEAR)
        self.steps, self.level_steps = self.steps + 1, self.level_steps + 1 if is_level else 0
        masses = self.masses(counts)
        self.most = max(self.most, masses["poured"])
        return Step(counts, counts.distance, counts.in_region, rotation, last,
                    masses["poured"] / self.target, masses["spilled"] / self.target)

    def masses(self, counts: mpm.Counts) -> dict[str, float]:
        """Return where the grains are, by their mass [kg]; the sum is the load.
        poured: in the receiver; in a task without one, in the tool. spilled: beside the receiver, below its rim; in a
        task without one, outside the bounds. held: in the tool. elsewhere: in the air, or in the container."""
        n, held = self.task.grains.count, counts.in_inner
        if self.task.receiver is None:
            numbers = held, counts.exited, held, n - held - counts.exited
        else:
            spilled = max(counts.exited - counts.in_region, 0)
            numbers = counts.in_region, spilled, held, max(n - held - counts.in_region - spilled, 0)
        return {name: self.grain_mass * number
                for name, number in zip(("poured", "spilled", "held", "elsewhere"), numbers)}

    def readings(self, counts: mpm.Counts) -> dict[str, float]:
        """Return the dose: masses [kg], the error in kg and in % of the target, and the time [s].
        overshoot: by how much the mass has been above the target."""
        masses = self.masses(counts)
        error = masses["poured"] - self.target
        return {"poured": masses["poured"], TARGET_MASS: self.target, "dose_error": error,
                "dose_error_percent": 100.0 * error / self.target, "overshoot": max(self.most - self.target, 0.0),
                "seconds": self.steps * self.task.step_dt, **masses}

    def is_success(self, counts: mpm.Counts, readings: dict[str, float]) -> bool:
        allowed = accepted_error(self.target, self.dose.tolerance_percent, self.dose.tolerance_g)
        return bool(abs(self.masses(counts)["poured"] - self.target) <= allowed)


def load_mass(task: TaskConfig, density: float, volume: float) -> tuple[float, str]:
    """Return the largest mass [kg] that a dosing task can give, and what it is in words.
    density: of the material [kg/m^3]. volume: of one grain [m^3]. A tool that begins empty is filled level at most."""
    total = task.grains.count * volume * density
    if task.carried:
        return total, f"the {task.tool_name} holds"
    return min(total, tool_shape(task.tool).capacity * density), f"the {task.tool_name} has room for"


def build_reward(task: TaskConfig) -> Reward:
    """Build the reward of a task from its terms."""
    return Reward(task.reward, RewardScene(task.steps, task.grains.counted, task.goal, task.grains.elites is not None,
                                           "poured" in task.reward))


def build_outcome(task: TaskConfig) -> Outcome:
    """Build what the episodes of a task are measured by."""
    return Outcome(task) if task.dose is None else Dose(task)

"""Dosing controllers as policies: observations become sights, commands become actions."""

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robosim.base.errors import ConfigError
from robosim.base.resources import config_names
from robosim.dosing.command import DoseCommand, DoseSight, accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import DosingNumbers, check_tool, load_dosing
from robosim.envs.grain_env import GrainEnv
from robosim.shapes import tool_shape
from robosim.tasks.sections import DosingConfig, VibrationConfig
from robosim.tasks.task import TaskConfig

TERMS = ("tool", "goal", "time", "scale", "target")
"""Terms of the observation that controllers read."""


def numbers_of(task: TaskConfig, name: str) -> DosingNumbers:
    """Return the numbers that a task's controllers work with; name: of the controller, for messages.
    Raises ConfigError for a task without a dose, or without numbers, and as `check_numbers`."""
    if task.dose is None:
        raise ConfigError(f"{name}: the task has no section dose; accepted: dosing tasks")
    if task.dose.controllers is None:
        raise ConfigError(f"{name}: the task's dose.controllers is missing; accepted: a file of configs/dosing "
                          f"({', '.join(config_names('dosing'))}), or the path of one's own")
    return check_numbers(load_dosing(task.dose.controllers), task, name)


def check_numbers(numbers: DosingNumbers, task: TaskConfig, name: str) -> DosingNumbers:
    """Return the numbers; raise ConfigError for those of another tool, and a dose longer than the task's episode."""
    check_tool(numbers, task.tool_name, f"{name}: dose.controllers")
    if numbers.motion.duration > task.steps * task.step_dt * (1.0 + 1e-9):
        raise ConfigError(f"{name}: motion.duration = {numbers.motion.duration:g} s; accepted in this task: up "
                          f"to its {task.steps} steps of {task.step_dt} s, {task.steps * task.step_dt:g} s")
    return numbers


def check_dosing(task: TaskConfig, name: str) -> tuple[DosingConfig, VibrationConfig]:
    """Return a task's dose and vibration; raise ConfigError without them or a receiver. name: the task's, in words."""
    if task.dose is None or task.action.vibration is None:
        raise ConfigError(f"{name}: no section dose, or no action.vibration; accepted: dosing tasks")
    if task.receiver is None:
        raise ConfigError(f"{name}: no empty container, whose balance dosing controllers read; accepted: dosing tasks "
                          f"that pour into a receiver, as DoseSpoon does")
    return task.dose, task.action.vibration


class ToolView:
    """What of an environment's observations and actions is a dosing tool's: its lip, its tilt, its vibration.
    The balance is tared at the first look. The tilt is continuous from look to look, also beyond 180 deg. Raises
    ConfigError for an environment that does not observe TERMS, or whose task has no dose, no vibration or no receiver.
    """

    def __init__(self, env: GrainEnv) -> None:
        task, spaces = env.task, getattr(env.observation_space, "spaces", None)
        self._slices = env.observation_slices if spaces is None else None
        """Where each term is in an observation that is one array; None where it is a dictionary."""
        self.dose, self.vibration = check_dosing(task, env.TASK or "task")
        if missing := [term for term in TERMS if term not in (spaces or self._slices or ())]:
            raise ConfigError(f"obs: {', '.join(missing)} missing; accepted for dosing controllers: obs={list(TERMS)}")
        self._action, self._duration = task.action, task.steps * task.step_dt
        level = task.start.pitch_deg if self.dose.level_pitch_deg is None else self.dose.level_pitch_deg
        lip = tool_shape(task.tool).lip
        if lip is None:
            raise ConfigError(f"tool {task.tool_name!r}: its pouring edge is not known; accepted: a tool with lip, "
                              f"inner_face or holes, or whose mesh is an open surface with a thickness")
        self._level, self._lip = np.radians(level), lip
        self._tare: float | None = None
        self._tilt = 0.0

    def look(self, observation: Any) -> DoseSight:
        """Return what a controller sees of an observation, a dictionary of terms or an array of them."""
        if self._slices is not None:
            observation = {name: observation[part] for name, part in self._slices.items()}
        position, quaternion = np.split(np.asarray(observation["tool"], float), [3])
        R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        shown, target = (float(observation[name][0]) for name in ("scale", "target"))
        if self._tare is None:
            self._tare = shown
        self._pitch_axis, self._origin = R[:, 1], position
        turned = float(np.arctan2(-R[2, 0], R[2, 2])) - self._level - self._tilt
        self._tilt += math.remainder(turned, 2.0 * math.pi)
        goal = position + np.asarray(observation["goal"], float)
        return DoseSight(float(observation["time"][0]) * self._duration, shown - self._tare, target,
                         self._tilt, position + R @ self._lip, goal)

    def act(self, sight: DoseSight, command: DoseCommand) -> np.ndarray:
        """Return the action (8,) that moves the lip and turns about it, at most as fast as an action can.
        sight: of the last look."""
        angular = command.tilt_rate * self._pitch_axis
        linear = command.velocity + np.cross(angular, self._origin - sight.lip)
        motion = np.concatenate([linear / self._action.speed, angular / self._action.angular_speed])
        motion /= max(1.0, float(np.abs(motion).max()))  # slower, but along the same way
        low, high = self.vibration.frequency
        shaking = [2.0 * command.amplitude / self.vibration.amplitude - 1.0,
                   2.0 * (command.frequency - low) / (high - low) - 1.0 if high > low else 0.0]
        return np.clip(np.concatenate([motion, shaking]), -1.0, 1.0).astype(np.float32)


class DosingPolicy:
    """A controller at work in an environment that observes TERMS.
    numbers: in place of those that the task names. Raises ConfigError for an environment that `ToolView` refuses, for
    numbers whose vibration is beyond the task's, and as `check_numbers`."""

    def __init__(self, name: str, env: GrainEnv, numbers: DosingNumbers | None = None) -> None:
        self._view = ToolView(env)
        where, vibration = f"policy {name!r}", self._view.vibration
        numbers = numbers_of(env.task, where) if numbers is None else check_numbers(numbers, env.task, where)
        low, high = vibration.frequency
        if not low <= numbers.vibration.frequency <= high or numbers.vibration.amplitude > vibration.amplitude:
            raise ConfigError(f"policy {name!r}: vibration of {numbers.vibration.amplitude} m at "
                              f"{numbers.vibration.frequency} Hz; accepted in this task: up to {vibration.amplitude} m "
                              f"at {low:g} to {high:g} Hz")
        self.controller = make_controller(name, numbers, env.action_repeat * env.task.step_dt)
        self.command: DoseCommand | None = None
        """The last command; None before the first."""

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the next action (8,)."""
        sight = self._view.look(observation)
        if self.command is None:
            dose = self._view.dose
            self.controller.start(sight.target, accepted_error(sight.target, dose.tolerance_percent, dose.tolerance_g))
        self.command = self.controller.command(sight)
        return self._view.act(sight, self.command)

"""What dosing controllers see of observations, and what becomes of their commands; the numbers of a task."""

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robosim.base.errors import ConfigError
from robosim.base.resources import config_names
from robosim.dosing.command import DoseCommand, DoseSight
from robosim.dosing.numbers import DosingNumbers, check_tool, load_dosing
from robosim.envs.grain_env import GrainEnv
from robosim.shapes import tool_shape
from robosim.tasks.observation import dose_terms
from robosim.tasks.sections import DosingConfig, VibrationConfig
from robosim.tasks.task import TaskConfig

GRAVITY = 9.81
"""Acceleration by which a force becomes a mass [m/s^2]."""


def terms_of(task: TaskConfig) -> tuple[str, ...]:
    """Return the terms of the observation that controllers read: with the balance of a receiver, or with the wrist."""
    return tuple(term for term in dose_terms(task) if term != "height_map")


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
    """Return a task's dose and vibration; raise ConfigError without them. name: the task's, in words."""
    if task.dose is None or task.action.vibration is None:
        raise ConfigError(f"{name}: no section dose, or no action.vibration; accepted: dosing tasks")
    return task.dose, task.action.vibration


class ToolView:
    """What of an environment's observations and actions is a dosing tool's: its lip, its tilt, its vibration.
    The balance of a receiver is tared at the first look. Without a receiver what has left the tool is shown, by the
    wrist's force; `tare` says from which load on. The tilt is continuous from look to look, also beyond 180 deg. Raises
    ConfigError for an environment that does not observe the terms of `terms_of`, or whose task has no dose or no
    vibration."""

    def __init__(self, env: GrainEnv) -> None:
        task, spaces = env.task, getattr(env.observation_space, "spaces", None)
        self._slices = env.observation_slices if spaces is None else None
        """Where each term is in an observation that is one array; None where it is a dictionary."""
        self.dose, self.vibration = check_dosing(task, env.TASK or "task")
        terms = terms_of(task)
        if missing := [term for term in terms if term not in (spaces or self._slices or ())]:
            raise ConfigError(f"obs: {', '.join(missing)} missing; accepted for dosing controllers: obs={list(terms)}")
        self._weighs_tool = task.receiver is None
        self._action, self._duration = task.action, task.steps * task.step_dt
        level = task.start.pitch_deg if self.dose.level_pitch_deg is None else self.dose.level_pitch_deg
        lip = tool_shape(task.tool).lip
        if lip is None:
            raise ConfigError(f"tool {task.tool_name!r}: its pouring edge is not known; accepted: a tool with lip, "
                              f"inner_face or holes, or whose mesh is an open surface with a thickness")
        self._level, self._lip = np.radians(level), lip
        self._tare: float | None = None
        self._tilt = 0.0

    def terms(self, observation: Any) -> Any:
        """Return the terms of an observation by name, of a dictionary or of one array."""
        if self._slices is not None:
            return {name: observation[part] for name, part in self._slices.items()}
        return observation

    def time(self, observation: Any) -> float:
        """Return the time since the start [s]."""
        return float(self.terms(observation)["time"][0]) * self._duration

    def tare(self, shown: float) -> None:
        """Let a mass [kg] that is shown count as none."""
        self._tare = shown

    def look(self, observation: Any) -> DoseSight:
        """Return what a controller sees of an observation, a dictionary of terms or an array of them."""
        observation = self.terms(observation)
        position, quaternion = np.split(np.asarray(observation["tool"], float), [3])
        R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        shown = -held_mass(R, observation["wrist"]) if self._weighs_tool else float(observation["scale"][0])
        target = float(observation["target"][0])
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


def held_mass(R: np.ndarray, wrist: np.ndarray) -> float:
    """Return the mass [kg] of what a tool at rest holds.
    R: axes of the tool in the world (3, 3). wrist: force [N] and torque in these axes (6,)."""
    return float((R @ np.asarray(wrist, float)[:3])[2]) / GRAVITY

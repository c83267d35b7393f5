"""Dosing controllers at work: observations become sights, commands become actions; and pulses that are changed."""

from pathlib import Path
from typing import Any, cast

import numpy as np

from mpm.array_files import StoredArrays
from robosim.base.errors import ConfigError
from robosim.dosing.command import DoseCommand, DoseSight, accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.pi import PiDosing
from robosim.dosing.pulses import CHANGES, OBSERVED, PulseSight, pulse_factors
from robosim.envs.grain_env import GrainEnv
from robosim.studies.policies import PULSED
from robosim.studies.policies.network import Network
from robosim.studies.policies.scooping import Scooping
from robosim.studies.policies.tool_view import ToolView, check_numbers, numbers_of


class DosingPolicy:
    """A controller at work in an environment that observes `terms_of` its task.
    Where the task has no receiver, it fills the tool first and pours back what is too much. numbers: in place of those
    that the task names. Raises ConfigError for an environment that `ToolView` or `Scooping` refuses, for numbers whose
    vibration is beyond the task's, and as `check_numbers`."""

    def __init__(self, name: str, env: GrainEnv, numbers: DosingNumbers | None = None) -> None:
        self._view = ToolView(env)
        where, vibration = f"policy {name!r}", self._view.vibration
        numbers = numbers_of(env.task, where) if numbers is None else check_numbers(numbers, env.task, where)
        low, high = vibration.frequency
        if not low <= numbers.vibration.frequency <= high or numbers.vibration.amplitude > vibration.amplitude:
            raise ConfigError(f"policy {name!r}: vibration of {numbers.vibration.amplitude} m at "
                              f"{numbers.vibration.frequency} Hz; accepted in this task: up to {vibration.amplitude} m "
                              f"at {low:g} to {high:g} Hz")
        self._scooping = Scooping(env, self._view, where) if env.task.receiver is None else None
        self.controller = make_controller(name, numbers, env.action_repeat * env.task.step_dt)
        self.command: DoseCommand | None = None
        """The last command; None before the first."""
        self._target = 0.0
        self._goal: np.ndarray | None = None
        """Where the lip pours back [m]; None: at the task's goal."""

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the next action (8,)."""
        if self._scooping is not None and (action := self._scooping(observation)) is not None:
            return action
        sight = self._view.look(observation)
        if self.command is None:
            self._begin(sight)
        if self._goal is not None:
            sight = sight._replace(target=self._target, goal=self._goal)
        self.command = self.controller.command(sight)
        return self._view.act(sight, self.command)

    def _begin(self, sight: DoseSight) -> None:
        dose = self._view.dose
        accepted, self._target = accepted_error(sight.target, dose.tolerance_percent, dose.tolerance_g), sight.target
        if self._scooping is not None and self._scooping.load is not None:
            self._target, self._goal = max(self._scooping.load - sight.target, 0.0), sight.lip
        self.controller.start(self._target, accepted)


class PulsedDosing(DosingPolicy):
    """The dosing controller PULSED at work; raises what DosingPolicy raises."""

    def __init__(self, env: GrainEnv) -> None:
        super().__init__(PULSED, env)

    @property
    def pulse(self) -> PulseSight | None:
        """The pulse that the last action begins; None where it begins none."""
        return cast(PiDosing, self.controller).pulse

    def change(self, change: np.ndarray) -> None:
        """Change the pulse that the last action begins; change (CHANGES,): of -1 to 1, as of `pulse_factors`."""
        cast(PiDosing, self.controller).change(*pulse_factors(change))


class PulsePolicy(PulsedDosing):
    """A network that changes the strength and the time of each pulse.
    It sees the pulse, OBSERVED numbers; `residual` of its file scales what it gives. Raises ConfigError,
    mpm.InvalidValue for a network that does not fit, and what DosingPolicy raises."""

    def __init__(self, path: Path, arrays: StoredArrays, env: GrainEnv) -> None:
        super().__init__(env)
        self._network = Network(path, arrays)
        self._network.check_sizes("pulses", (OBSERVED,), CHANGES)
        self._share = float(arrays.numbers("residual").flat[0])

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the next action (8,)."""
        action = super().__call__(observation)
        if self.pulse is not None:
            self.change(self._share * self._network(self.pulse.observe()))
        return action

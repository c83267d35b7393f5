"""A tool that begins empty: the task's script fills it with more than is wanted, and it is weighed at the wrist."""

from typing import Any

import numpy as np

from robosim.base.errors import ConfigError
from robosim.envs.grain_env import GrainEnv
from robosim.studies.policies.script import ScriptedPolicy
from robosim.studies.policies.tool_view import ToolView
from robosim.tasks.actions import rest_action

REST, WEIGHED = 0.6, 0.3
"""Time [s] that the filled tool hangs at rest, and the part of it, the last, in which it is weighed."""


class Scooping:
    """Actions that fill the tool by the task's script, and weigh it; then what leaves the tool is shown, from 0 on.
    Raises ConfigError for a task without a script, and with an arm, whose wrist also carries hand and tool."""

    def __init__(self, env: GrainEnv, view: ToolView, name: str) -> None:
        if not env.task.script:
            raise ConfigError(f"{name}: the task has no section script; accepted: one with it, which fills the tool")
        if env.carrier.robot_data is not None:
            raise ConfigError(f"{name}: arm=True with a tool that begins empty; accepted: without an arm, where the "
                              f"wrist's force is that of the grains alone")
        self._view, self._script, self._rest = view, ScriptedPolicy(env), rest_action(env.task)
        self._filled = env.task.script[-1].time
        self._weighed: list[float] = []
        self.load: float | None = None
        """Mass in the filled tool [kg]; None until it is weighed."""

    def __call__(self, observation: Any) -> np.ndarray | None:
        """Return the next action (size,), None once the filled tool is weighed."""
        if self.load is not None:
            return None
        time = self._view.time(observation) + 1e-9
        if time < self._filled:
            return self._script(observation)
        if time >= self._filled + REST - WEIGHED:
            self._view.tare(0.0)
            self._weighed.append(-self._view.look(observation).shown)
        if time < self._filled + REST:
            return self._rest.copy()
        self.load = float(np.mean(self._weighed))
        self._view.tare(-self.load)
        return None

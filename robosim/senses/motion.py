"""Terms that need no sensor: the tool's pose, the goal, the mass to dose and the clock."""

from typing import Any

import numpy as np

from robosim.config.bounds import LARGEST_DOSE
from robosim.senses.term import SenseScene, Sight, Term, box
from robosim.tasks.observation import tool_bounds

FAR_PLACE = np.array([1.5, 1.5, 0.0])
"""The most [m] by which a drawn place of the goal can be displaced: a shift and a turn."""


class ToolTerm(Term):
    """Position of the tool's frame in the world, and its quaternion (w, x, y, z) where the task turns the tool.

    Where the robot takes the tool to be: without an error of its place in the hand."""

    name, unit = "tool", "m, 1"

    def __init__(self, scene: SenseScene) -> None:
        self._turns = scene.task.action.dimensions == 6
        self.space = box(*tool_bounds(scene.task, scene.solver.grid))

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the pose (7,), or the position (3,)."""
        return np.concatenate(sight.believed) if self._turns else sight.believed.position


class GoalTerm(Term):
    """Vector (3,) from the tool's frame to the task's goal, in world axes."""

    name, unit = "goal", "m"

    def __init__(self, scene: SenseScene) -> None:
        low, high = (bounds[:3] for bounds in tool_bounds(scene.task, scene.solver.grid))
        self._goal = np.array(scene.task.goal)
        self.space = box(self._goal - high - FAR_PLACE, self._goal - low + FAR_PLACE)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        return sight.setting.place.apply(self._goal[None])[0] - sight.believed.position


class TargetTerm(Term):
    """Mass to dose in this episode."""

    name, unit = "target", "kg"

    def __init__(self, scene: SenseScene) -> None:
        self.space = box([0.0], [1e-3 * LARGEST_DOSE])

    @classmethod
    def missing(cls, scene: SenseScene) -> str:
        return "" if scene.task.dose is not None else "a dosing task"

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        return np.array([sight.setting.target_mass])


class TimeTerm(Term):
    """Share of the episode that is over."""

    name, unit = "time", "1"

    def __init__(self, scene: SenseScene) -> None:
        self.space = box([0.0], [1.0])

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        return np.array([sight.progress])


class PendingTerm(Term):
    """Mean of the commands that are not yet carried out, as an action without vibration; 0 without `action_delay`."""

    name, unit = "pending", "1"

    def __init__(self, scene: SenseScene) -> None:
        action = scene.task.action
        self._scale = np.array([action.speed] * 3 + [action.angular_speed] * 3)[: action.dimensions]
        self.space = box(-np.ones(action.dimensions), np.ones(action.dimensions))

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        velocities = [np.concatenate(one[:2])[: len(self._scale)] for one in sight.waiting]
        steps = [one[-1] for one in sight.waiting]
        return np.average(velocities, 0, steps) / self._scale if steps else np.zeros(len(self._scale))

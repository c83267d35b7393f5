"""Terms that need no sensor: the tool's pose, the goal and the clock."""

from typing import Any

import numpy as np

from robosim.senses.term import SenseScene, Sight, Term, box
from robosim.tasks.observation import tool_bounds


class ToolTerm(Term):
    """Position of the tool's frame in the world, and its quaternion (w, x, y, z) where the task turns the tool."""

    name, unit = "tool", "m, 1"

    def __init__(self, scene: SenseScene) -> None:
        self._turns = scene.task.action.dimensions == 6
        self.space = box(*tool_bounds(scene.task, scene.solver.grid))

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the pose (7,), or the position (3,)."""
        return np.concatenate(sight.pose) if self._turns else sight.pose.position


class GoalTerm(Term):
    """Vector from the tool's frame to the task's goal, in world axes."""

    name, unit = "goal", "m"

    def __init__(self, scene: SenseScene) -> None:
        low, high = (bounds[:3] for bounds in tool_bounds(scene.task, scene.solver.grid))
        self._goal = np.array(scene.task.goal)
        self.space = box(self._goal - high, self._goal - low)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the vector (3,)."""
        return self._goal - sight.pose.position


class TimeTerm(Term):
    """Share of the episode that is over."""

    name, unit = "time", "1"

    def __init__(self, scene: SenseScene) -> None:
        self.space = box([0.0], [1.0])

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the share (1,)."""
        return np.array([sight.progress])

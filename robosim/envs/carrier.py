"""What carries the tool: told where to be, and without an arm it is there at once."""

from collections.abc import Iterator
from typing import Any

import numpy as np

import mpm
from mpm.geometry.rigid_motion import turned
from robosim.tasks.counting import MAX_READINGS, TOOL, Reading
from robosim.tasks.task import TaskConfig

Step = tuple[Reading, mpm.Pose]
"""What was read after a step of `step_dt`, and where the tool was then."""


class Carrier:
    """What is told where the tool shall be. The tool's origin stays in its box."""

    def __init__(self, task: TaskConfig) -> None:
        self._dt = task.step_dt
        self._lower, self._upper = np.array(task.action.lower), np.array(task.action.upper)
        self.commanded = task.start.pose
        """Where the tool is told to be."""

    robot: Any = None
    """MuJoCo's data of the scene with the arm, where there is one."""

    @property
    def strain(self) -> dict[str, float]:
        """What the episode so far has asked of the arm; nothing without one."""
        return {}

    def spec(self) -> Any:
        """Specification of that scene."""
        return None

    def restart(self, pose: mpm.Pose) -> mpm.Pose:
        """Begin an episode with the tool at a pose; returns where it is really."""
        self.commanded = pose
        return pose

    def hold(self, linear: np.ndarray, angular: np.ndarray, steps: int) -> Iterator[Step]:
        """Command velocities for some steps and advance."""
        raise NotImplementedError

    def command(self, linear: np.ndarray, angular: np.ndarray) -> mpm.Pose:
        """Move the commanded pose on by one step of `step_dt`, with velocities [m/s], [rad/s] in world axes."""
        place = np.minimum(np.maximum(self.commanded.position + self._dt * linear, self._lower), self._upper)
        self.commanded = mpm.Pose(place, turned(self.commanded.quaternion, self._dt * angular))
        return self.commanded


class KinematicTool(Carrier):
    """Moves the tool's collider; nothing of arm or MuJoCo is there."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver) -> None:
        super().__init__(task)
        self._solver = solver

    def hold(self, linear: np.ndarray, angular: np.ndarray, steps: int) -> Iterator[Step]:
        """Hold velocities [m/s], [rad/s] in world axes; as many steps as the solver can look at in one launch."""
        for first in range(0, steps, MAX_READINGS):
            way = [self.command(linear, angular) for _ in range(min(MAX_READINGS, steps - first))]
            self._solver.set_collider_motion(TOOL, self._solver.collider_pose(TOOL), *way)
            yield from zip(self._solver.advance(len(way) * self._dt, looks=len(way)), way, strict=True)

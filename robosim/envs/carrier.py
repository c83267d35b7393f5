"""What carries the tool: told where to be, and without an arm it is there at once."""

from collections.abc import Iterator
from typing import Any

import numpy as np

import mpm
from mpm.motion import turned
from mpm.solver import MAX_LOOKS
from robosim.envs.task import TaskConfig
from robosim.envs.task_field import TOOL


class Carrier:
    """What is told where the tool shall be. The tool's origin stays in its box."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver, tally: mpm.Tally) -> None:
        self._solver, self._tally, self._dt = solver, tally, task.step_dt
        self._lower, self._upper = np.array(task.action.lower), np.array(task.action.upper)
        self.commanded = solver.collider_pose(TOOL)
        """Where the tool is told to be."""

    robot: Any = None
    """MuJoCo's data of the scene with the arm, where there is one."""

    def spec(self) -> Any:
        """Specification of that scene."""
        return None

    def restart(self, pose: mpm.Pose) -> mpm.Pose:
        """Begin an episode with the tool at a pose; returns where it is really."""
        self.commanded = pose
        return pose

    def hold(self, linear: np.ndarray, angular: np.ndarray, steps: int) -> Iterator[mpm.Tallied]:
        """Command velocities for some steps and advance; what was read after each step of `step_dt`."""
        raise NotImplementedError

    def command(self, linear: np.ndarray, angular: np.ndarray) -> None:
        """Move the commanded pose on by one step of `step_dt`, with velocities [m/s], [rad/s] in world axes."""
        place = np.minimum(np.maximum(self.commanded.position + self._dt * linear, self._lower), self._upper)
        self.commanded = mpm.Pose(place, turned(self.commanded.quaternion, self._dt * angular))


class KinematicTool(Carrier):
    """Moves the tool's collider; nothing of arm or MuJoCo is there."""

    def hold(self, linear: np.ndarray, angular: np.ndarray, steps: int) -> Iterator[mpm.Tallied]:
        """Hold velocities [m/s], [rad/s] in world axes; what was read after each step of `step_dt`.

        As many steps as the solver can look at go into one launch; ranked grains are looked at from outside.
        """
        at_once = 1 if self._tally.ranks else MAX_LOOKS
        while steps > 0:
            n = min(steps, at_once)
            steps -= n
            way = [self._solver.collider_pose(TOOL)]
            for _ in range(n):
                self.command(linear, angular)
                way.append(self.commanded)
            self._solver.set_collider_motion(TOOL, *way)
            read = self._solver.advance(n * self._dt, looks=n)
            yield from read or [self._tally.read()]

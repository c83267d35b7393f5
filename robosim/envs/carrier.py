"""What carries the tool when no arm does: it goes where it is told."""

import numpy as np

import mpm
from mpm.motion import turned
from robosim.envs.task import TaskConfig
from robosim.envs.task_field import TOOL


class KinematicTool:
    """Moves the tool's collider; nothing of arm or MuJoCo is there."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver) -> None:
        self._solver, self._dt = solver, task.step_dt
        self._lower, self._upper = np.array(task.action.lower), np.array(task.action.upper)
        self.commanded = solver.collider_pose(TOOL)
        """Where the tool is told to be."""

    def restart(self, pose: mpm.Pose) -> None:
        """A new episode, with the grains already in place."""
        self.commanded = pose

    def step(self, linear: np.ndarray, angular: np.ndarray) -> None:
        """One step of `step_dt` with velocities [m/s], [rad/s] in world axes; the origin stays in its box."""
        self.command(linear, angular)
        self._solver.set_collider_motion(TOOL, self._solver.collider_pose(TOOL), self.commanded)
        self._solver.advance(self._dt)

    def command(self, linear: np.ndarray, angular: np.ndarray) -> None:
        """Move the commanded pose on by one step."""
        place = np.minimum(np.maximum(self.commanded.position + self._dt * linear, self._lower), self._upper)
        self.commanded = mpm.Pose(place, turned(self.commanded.quaternion, self._dt * angular))

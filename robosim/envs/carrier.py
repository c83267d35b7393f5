"""Carriers: what moves the tool to its commanded pose. Without an arm the tool is there at once."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import mpm
from mpm.observers.region_counter import MAX_READINGS
from robosim.dosing.motion import Vibration
from robosim.envs.episode import read_pose
from robosim.tasks.actions import move_pose
from robosim.tasks.counting import TOOL
from robosim.tasks.draw import STANDARD, Setting, read_setting
from robosim.tasks.task import TaskConfig

ORIGIN = np.zeros(3)
Step = tuple[mpm.Counts, mpm.Pose]
"""The field's reading after a step of `step_dt`, and the tool's pose then."""


class Carrier:
    """Integrates commanded velocities, and moves the tool's collider along; a subclass has an arm move it.
    solver: the field that `advance` advances; None where somebody else does."""

    robot_data: Any = None
    """MuJoCo's data of the scene with the arm; None without an arm."""
    sensors: Any = None
    """An `ArmSampler`; None without an arm, and where no term of the observation reads it."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver | None = None) -> None:
        self._task, self._dt, self._solver = task, task.step_dt, solver
        self.commanded = task.start.pose
        """Commanded pose of the tool in the world, where the robot takes it to be."""
        self.setting = STANDARD
        """How the scene of the running episode differs from the task's."""
        vibration = task.action.vibration
        self._vibration = None if vibration is None else Vibration(vibration.axis)
        self.received, self.duration = np.zeros(6), 0.0
        """Impulse [N s], [N m s] on the tool in the present action, about the world's origin, and its time [s]; zero
        with an arm, which has a sensor for it."""

    @property
    def arm_readings(self) -> dict[str, float]:
        """Readings of the arm over the episode so far; empty without an arm."""
        return {}

    def build_spec(self) -> Any:
        """Build MuJoCo's specification of the scene with the arm; None without an arm."""
        return None

    def restart(self, pose: mpm.Pose, setting: Setting = STANDARD) -> mpm.Pose:
        """Begin an episode with the tool commanded to a pose; return the pose that it has."""
        self.commanded, self.setting = pose, setting
        self.received, self.duration = np.zeros(6), 0.0
        if self._vibration is not None:
            self._vibration.restart()
        return setting.actual(pose)

    def begin_action(self) -> None:
        """Forget what sensors have measured so far: they show means over an action."""
        self.received, self.duration = np.zeros(6), 0.0

    def state(self) -> dict[str, Any]:
        """Return what the next step depends on besides the field: arrays and plain values."""
        shaking = {} if self._vibration is None else {"vibration": self._vibration.state()}
        return {"commanded": np.concatenate(self.commanded), "setting": self.setting.state(), **shaking}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        self.commanded, self.setting = read_pose(state["commanded"]), read_setting(state["setting"])
        if self._vibration is not None:
            self._vibration.load(state["vibration"])

    def receive(self, impulse: np.ndarray, duration: float) -> None:
        """Add an impulse (6,) of the grains on the tool, about the world's origin, that took a time [s]."""
        self.received, self.duration = self.received + impulse, self.duration + duration

    def advance(self, velocity: Sequence[np.ndarray], steps: int) -> Iterator[Step]:
        """Advance by steps under a constant `robosim.tasks.actions.Velocity`, and yield each step.
        Without an arm in as few launches as the field's readings allow."""
        solver = self._solver
        assert solver is not None
        for first in range(0, steps, MAX_READINGS):
            poses = [self.command(*velocity) for _ in range(min(MAX_READINGS, steps - first))]
            solver.set_collider_motion(TOOL, solver.collider_pose(TOOL), *poses)
            readings = solver.advance(len(poses) * self._dt, readings=len(poses))
            self.receive(np.concatenate(solver.collider_impulse(TOOL, ORIGIN)), len(poses) * self._dt)
            yield from zip(readings, poses, strict=True)

    def command(self, linear: np.ndarray, angular: np.ndarray, vibration: np.ndarray | None = None) -> mpm.Pose:
        """Move the commanded pose by one step of velocities [m/s], [rad/s] in world axes; return the tool's there.
        vibration: amplitude [m] and frequency [Hz] (2,), if any, added to what is returned, and not to `commanded`."""
        self.commanded = move_pose(self.commanded, self._task, linear, angular)
        pose = self.setting.actual(self.commanded)
        if self._vibration is None or vibration is None:
            return pose
        return self._vibration.shake(pose, self._dt, *vibration)

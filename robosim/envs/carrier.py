"""Carriers: what moves the tool to its commanded pose. Without an arm the tool is there at once."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import mpm
from mpm.geometry.rigid_motion import rotate
from mpm.observers.region_counter import MAX_READINGS
from robosim.envs.episode import read_pose
from robosim.randomization.draw import STANDARD, Setting, read_setting
from robosim.tasks.counting import TOOL
from robosim.tasks.dosing import Vibration
from robosim.tasks.task import TaskConfig

ORIGIN = np.zeros(3)
Step = tuple[mpm.Counts, mpm.Pose]
"""The field's reading after a step of `step_dt`, and the tool's pose then."""


class Carrier:
    """Integrates commanded velocities; the origin of the tool's frame stays in the task's box.

    Subclasses advance the field with the tool on the way to the commanded pose.
    """

    robot_data: Any = None
    """MuJoCo's data of the scene with the arm; None without an arm."""
    sensors: Any = None
    """An `ArmSampler`; None without an arm, and where no term of the observation reads it."""

    def __init__(self, task: TaskConfig) -> None:
        self._dt = task.step_dt
        self._lower, self._upper = np.array(task.action.lower), np.array(task.action.upper)
        self.commanded = task.start.pose
        """Commanded pose of the tool in the world, where the robot takes it to be."""
        self.setting = STANDARD
        """How the scene of the running episode differs from the task's."""
        self._vibration = None if task.action.vibration is None else Vibration(task)
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
        """Advance by steps under a constant `robosim.tasks.actions.Velocity`, and yield each step."""
        raise NotImplementedError

    def command(self, linear: np.ndarray, angular: np.ndarray, vibration: np.ndarray | None = None) -> mpm.Pose:
        """Move the commanded pose by one step of velocities [m/s], [rad/s] in world axes; return the tool's there.

        vibration: amplitude [m] and frequency [Hz] (2,), where the task has one; it is added to the pose that is
        returned, and `commanded` stays without it.
        """
        position = np.minimum(np.maximum(self.commanded.position + self._dt * linear, self._lower), self._upper)
        self.commanded = mpm.Pose(position, rotate(self.commanded.quaternion, self._dt * angular))
        pose = self.setting.actual(self.commanded)
        return pose if self._vibration is None or vibration is None else self._vibration.shake(pose, *vibration)


class KinematicTool(Carrier):
    """Moves the tool's collider along the commanded poses; neither arm nor MuJoCo take part."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver) -> None:
        super().__init__(task)
        self._solver = solver

    def advance(self, velocity: Sequence[np.ndarray], steps: int) -> Iterator[Step]:
        """Advance by steps under a constant velocity, in as few launches as the field's readings allow."""
        for first in range(0, steps, MAX_READINGS):
            poses = [self.command(*velocity) for _ in range(min(MAX_READINGS, steps - first))]
            self._solver.set_collider_motion(TOOL, self._solver.collider_pose(TOOL), *poses)
            readings = self._solver.advance(len(poses) * self._dt, readings=len(poses))
            self.receive(np.concatenate(self._solver.collider_impulse(TOOL, ORIGIN)), len(poses) * self._dt)
            yield from zip(readings, poses, strict=True)

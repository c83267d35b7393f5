"""What an episode has drawn, and what it makes of the scene."""

from typing import Any, NamedTuple

import numpy as np

import mpm

Vector = tuple[float, float, float]
HOME = mpm.Pose.identity()


class Draw(NamedTuple):
    """All that is random in an episode; `info["draw"]` of a reset has it as a dictionary."""

    numbers: dict[str, float]
    """Value of everything with a range."""
    tool: Vector = (0.0, 0.0, 0.0)
    """Displacement [m] of the tool from the task's start."""
    pile: Vector = (0.0, 0.0, 0.0)
    """Displacement [m] of grains that are not in the tool."""
    turn_deg: float = 0.0
    """Turn of the tool about the vertical."""
    sensors: int = 0
    """Seed of what is random in sensors."""
    material: str = ""
    """Label of the material; empty: the environment's own."""

    @property
    def grains(self) -> tuple[str, float, float]:
        """What settled starts differ by: material, fill, slope of the surface [deg]."""
        return self.material, self.numbers.get("fill", 1.0), self.numbers.get("surface_slope_deg", 0.0)


class Setting(NamedTuple):
    """How an episode's scene differs from the task's, and what one of its grains weighs."""

    place: mpm.Pose = HOME
    """Of container, target and bounds: from where the task has them to where they are."""
    mounting: mpm.Pose = HOME
    """Pose of the tool's frame in the frame where the robot takes it to be."""
    stiffness: float = 1.0
    """Factor on the servo's stiffness."""
    damping: float = 1.0
    """Factor on the servo's damping."""
    payload: float = 1.0
    """Factor on mass and inertia of hand and tool."""
    grain_mass: float = 0.0
    """[kg]"""
    target_mass: float = 0.0
    """To dose [kg]; 0 where nothing is."""

    def actual(self, believed: mpm.Pose) -> mpm.Pose:
        """Return where the tool is when the robot believes it at a pose."""
        return believed if self.mounting is HOME else believed @ self.mounting

    def believed(self, actual: mpm.Pose) -> mpm.Pose:
        """Return where the robot believes the tool when it is at a pose."""
        return actual if self.mounting is HOME else actual @ self.mounting.inverse()

    def state(self) -> dict[str, Any]:
        """Return the setting as arrays and plain values."""
        return {name: np.concatenate(value) if isinstance(value, mpm.Pose) else value
                for name, value in self._asdict().items()}


STANDARD = Setting()
"""The task's own scene."""


def read_setting(state: dict[str, Any]) -> Setting:
    """Return the setting that `Setting.state` returned."""
    poses = {name: mpm.Pose(*np.split(np.array(state[name], float), [3])) for name in ("place", "mounting")}
    kept = {name: HOME if np.array_equal(np.concatenate(pose), np.concatenate(HOME)) else pose
            for name, pose in poses.items()}
    return Setting(**{**state, **kept})

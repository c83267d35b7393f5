"""The scene, the robot, the coupling of grains and rigid bodies, rehearsals and their reports."""

import os

# MuJoCo chooses its OpenGL library when it is imported; without a display only EGL or OSMesa work
os.environ.setdefault("MUJOCO_GL", "egl")

from robosim.coupling import GranularPlugin  # noqa: E402
from robosim.errors import ConfigError, RobosimError, UnknownName, UnreachableWaypoint  # noqa: E402

__all__ = ["ConfigError", "GranularPlugin", "RobosimError", "UnknownName", "UnreachableWaypoint"]

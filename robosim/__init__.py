"""The scene, the robot, the coupling of grains and rigid bodies, rehearsals and their reports."""

from robosim.rendering.opengl import choose_graphics

choose_graphics()

from robosim.coupling.plugin import GranularPlugin  # noqa: E402
from robosim.envs import register  # noqa: E402
from robosim.errors import (  # noqa: E402
    BodyLeftGrid,
    ConfigError,
    RobosimError,
    RobotDiverged,
    UnknownName,
    UnreachableWaypoint,
)

register()

__all__ = ["BodyLeftGrid", "ConfigError", "GranularPlugin", "RobosimError", "RobotDiverged", "UnknownName",
           "UnreachableWaypoint"]

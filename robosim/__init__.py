"""The scene, the robot, the coupling of grains and rigid bodies, rehearsals and their reports."""

from robosim.graphics import choose_graphics

choose_graphics()

from robosim.coupling import GranularPlugin  # noqa: E402
from robosim.envs import register  # noqa: E402
from robosim.errors import ConfigError, RobosimError, UnknownName, UnreachableWaypoint  # noqa: E402

register()

__all__ = ["ConfigError", "GranularPlugin", "RobosimError", "UnknownName", "UnreachableWaypoint"]

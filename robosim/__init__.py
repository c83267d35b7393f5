"""The scene, the robot, the coupling of grains and rigid bodies, rehearsals and their reports.

`import robosim` registers the environments with Gymnasium and is light: a public name is imported where it is first
used, and Gymnasium itself only by who uses it.
"""

from typing import TYPE_CHECKING

from mpm.lazy_names import lazy_names
from robosim.envs import register_with_gymnasium
from robosim.rendering.opengl import choose_graphics

if TYPE_CHECKING:
    from robosim.coupling.plugin import GranularPlugin
    from robosim.errors import (
        BodyLeftGrid,
        ConfigError,
        RobosimError,
        RobotDiverged,
        UnknownName,
        UnreachableWaypoint,
    )

__all__ = ["BodyLeftGrid", "ConfigError", "GranularPlugin", "RobosimError", "RobotDiverged", "UnknownName",
           "UnreachableWaypoint"]

MODULES = {
    "robosim.coupling.plugin": ("GranularPlugin",),
    "robosim.errors": ("BodyLeftGrid", "ConfigError", "RobosimError", "RobotDiverged", "UnknownName",
                       "UnreachableWaypoint"),
}
"""Module -> the public names that it defines; the same as the imports above, which type checkers read."""

choose_graphics()  # before anything imports MuJoCo
register_with_gymnasium()

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, MODULES)

"""The scene, the robot, the coupling of grains and rigid bodies, rehearsals and their reports.

`import robosim` registers the environments with Gymnasium and is light: a public name is imported where it is first
used, and Gymnasium itself only by who uses it.
"""

from importlib import import_module
from typing import TYPE_CHECKING

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
    _MODULE_OF = {name: module for module, names in MODULES.items() for name in names}

    def __getattr__(name: str) -> object:
        """Import a public name (PEP 562) and remember it."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})

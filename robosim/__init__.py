"""The scene, the robot, the coupling of grains and rigid bodies, rehearsals and their reports.

`import robosim` registers the environments with Gymnasium and is light: a public name is imported where it is first
used, and Gymnasium itself only by who uses it."""

from typing import TYPE_CHECKING

from mpm.lazy_names import lazy_names
from robosim.envs import register_with_gymnasium
from robosim.rendering.opengl import choose_graphics

if TYPE_CHECKING:
    from robosim.base.errors import (
        BodyLeftGrid,
        ConfigError,
        DoubledFaces,
        DriverFault,
        RobosimError,
        RobotDiverged,
        UnknownName,
        UnreachableWaypoint,
    )
    from robosim.config.rehearsal import RehearsalConfig
    from robosim.coupling.plugin import GranularPlugin
    from robosim.rehearsal.result import Result
    from robosim.rehearsal.session import Rehearsal
    from robosim.rendering.video import Mp4Writer
    from robosim.scene.composing import Container
    from robosim.scene.grain_renderer import GrainRenderer

choose_graphics()  # before anything imports MuJoCo
register_with_gymnasium()

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

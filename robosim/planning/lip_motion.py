"""Motion of a tool about its lip: tilt, the lip's way, and a vibration on top of both."""

import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.dosing.command import DoseCommand
from robosim.dosing.motion import Vibration
from robosim.shapes import tool_shape

LEVEL = np.radians(1.0)
"""Largest angle [rad] of the waypoint's tool from level."""
ASIDE = 0.05
"""Largest horizontal distance [m] of the lip from the cup's middle at the waypoint."""


class LipMotion:
    """Tool poses under commands of a dosing controller, in world axes.
    start: pose of the level tool. lip: its lip in its own frame [m] (3,). goal: place of the lip while it pours [m]
    (3,). largest_tilt: [rad]; commands beyond it, or below level, have no effect, nor have those that lead the lip out
    of the box around its start and the goal. axis: along which it vibrates, in its frame."""

    def __init__(self, start: Pose, lip: np.ndarray, goal: np.ndarray, largest_tilt: float, axis: str = "x") -> None:
        self._start, self._local, self._largest = start, lip, largest_tilt
        self.goal = goal
        """[m] (3,)"""
        self.lip = start.apply(lip[None])[0]
        """Commanded place of the lip [m] (3,), without the vibration."""
        self._low, self._high = np.minimum(self.lip, goal), np.maximum(self.lip, goal)
        self.tilt = 0.0
        """Commanded tilt [rad]: rotation about the tool's y axis, which lowers its tip."""
        self.vibration, self._frequency = Vibration(axis), 0.0

    def pose(self, tilt: float | None = None, lip: np.ndarray | None = None) -> Pose:
        """Return the tool's pose without the vibration, by default the present one."""
        turn = Rotation.from_euler("y", self.tilt if tilt is None else tilt)
        rotation = Rotation.from_matrix(self._start.matrix) * turn
        place = self.lip if lip is None else lip
        return Pose(place - rotation.apply(self._local), rotation.as_quat(scalar_first=True))

    def advance(self, command: DoseCommand, dt: float) -> Pose:
        """Move by a command for dt [s]; return the tool's pose with the vibration."""
        self.tilt = float(np.clip(self.tilt + dt * command.tilt_rate, 0.0, self._largest))
        self.lip = np.clip(self.lip + dt * command.velocity, self._low, self._high)
        if command.amplitude > 0.0:  # a command of no amplitude may leave the frequency open
            self._frequency = command.frequency
        return self.vibration.shake(self.pose(), dt, command.amplitude, self._frequency)


def make_lip_motion(config: RehearsalConfig) -> LipMotion:
    """Make the motion of a rehearsal's tool from the waypoint of its dose.
    The goal is above the middle of the cup, at the height that the lip has at the waypoint. Raises ConfigError for a
    tool that is not level there, a lip that is not above the cup, and a cup that leans."""
    dose = config.dose
    assert dose is not None
    name = dose_cup(config)
    waypoint = next(w for w in config.waypoints if w.name == config.dose_at)
    start, cup = config.tool_pose(waypoint), config.containers[name]
    lean = np.arccos(np.clip(start.matrix[2, 2], -1.0, 1.0))
    if lean > LEVEL or any(cup.tilt_deg):
        raise ConfigError(f"dose.at: the tool leans by {np.degrees(lean):.1f} deg at waypoint {waypoint.name!r}, the "
                          f"cup {name!r} by {cup.tilt_deg} deg; accepted: a tool that leans by up to "
                          f"{np.degrees(LEVEL):g} deg, and a cup that stands upright")
    lip = tool_shape(config.tool).lip if dose.lip is None else np.array(dose.lip)
    if lip is None:
        raise ConfigError(f"dose.lip: missing, and the rim of the {config.tool_name} is not known; accepted: the lip's "
                          f"place in its frame")
    place = start.apply(lip[None])[0]
    goal = np.array([*cup.pose.position[:2], place[2]])
    away = float(np.linalg.norm(goal - place))
    if away > ASIDE:
        raise ConfigError(f"dose.at: at waypoint {waypoint.name!r} the lip of the {config.tool_name} is at "
                          f"{place.round(4).tolist()} m, {1e3 * away:.0f} mm aside of the middle of the cup "
                          f"{name!r} at {goal[:2].round(4).tolist()} m; accepted: up to {1e3 * ASIDE:g} mm")
    return LipMotion(start, lip, goal, np.radians(dose.largest_tilt_deg), dose.vibration_axis)


def dose_cup(config: RehearsalConfig) -> str:
    """Return the name of the container that takes the dose."""
    assert config.dose is not None
    return config.dose.cup or config.sinks[0]

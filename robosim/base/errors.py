"""Errors of the scene and the robot: what was given, where, and what would be accepted."""

import warnings
from collections.abc import Iterable

from mpm.errors import Picklable, say_unknown


class RobosimError(Picklable):
    """Base of every error that `robosim` raises on purpose."""


class ConfigError(RobosimError, ValueError):
    """A configuration that cannot be used."""


class UnknownName(ConfigError):
    """A name that is not in the list of accepted names."""

    def __init__(self, what: str, given: object, valid: Iterable[str], also: str = "") -> None:
        self.given, self.valid = given, sorted(valid)
        super().__init__(say_unknown(what, given, self.valid, also))


class UnreachableWaypoint(ConfigError):
    """A waypoint that the arm cannot reach."""

    def __init__(self, name: str, position_error: float, angle_error_deg: float, beyond_reach: float) -> None:
        self.name, self.position_error = name, position_error
        reach = (f"it lies {beyond_reach * 1e3:.0f} mm beyond the arm's reach" if beyond_reach > 0 else
                 "its place is within reach, its orientation is not, or joint limits stand in the way")
        super().__init__(f"waypoint {name!r} cannot be reached: the best posture found misses it by "
                         f"{position_error * 1e3:.1f} mm and {angle_error_deg:.2f} deg; {reach}")


class RobotDiverged(RobosimError):
    """MuJoCo reported a bad state, or no motion within the joints' limits was found."""

    def __init__(self, time: float, warnings: list[str]) -> None:
        self.time, self.warnings = time, warnings
        super().__init__(f"the robot diverged at t = {time:.6g} s: {', '.join(warnings)}")


class DriverFault(RobosimError):
    """A driver gave a command that the robot must not follow."""

    def __init__(self, driver: str, time: float, given: str, accepted: str) -> None:
        self.driver, self.time = driver, time
        super().__init__(f"driver {driver} at t = {time:.4f} s {given}; accepted: {accepted}")


class RobosimWarning(UserWarning):
    """Base of every warning that `robosim` gives."""


class BodyLeftGrid(RobosimWarning):
    """A coupled body is outside the solver's grid; it has no contact with grains until it returns."""


class DoubledFaces(RobosimWarning):
    """A mesh has faces twice; each is read once."""


def note(text: str, kind: type[RobosimWarning] = RobosimWarning, shown: set[str] = set()) -> None:  # noqa: B006
    """Warn, once of a text, in one line: Python shows no place in our code."""
    if text not in shown:
        shown.add(text)
        warnings.warn_explicit(text, kind, "robosim", 0)

"""What can be drawn in an episode, its domain, and the ranges that come with robosim."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from robosim.base.errors import ConfigError, UnknownName
from robosim.config.bounds import LARGEST_DOSE, LEAST_DOSE
from robosim.config.table import read
from robosim.tasks.sections import TARGET_MASS
from robosim.tasks.task import TaskConfig

Ranges = Mapping[str, Sequence[Any]]
"""Name -> its lowest and highest value; "material" -> names of materials."""
HARD = ("hard", "hard_unseen")
"""Presets of the hardened task, see `robosim.randomization.variants.hardened`; unseen: in materials of the suite."""
PRESETS = ("nominal", "wide", *HARD)
"""nominal: the random starts of the task alone, as published; wide, hard: `wide_ranges`, `hard_ranges`."""
MATERIAL = "material"
UNSEEN = ("salt, 10 deg smoother", "salt, 10 deg rougher", "salt, twice as dense", "salt, cohesion 100 Pa")
"""Materials of the suite hard, in which "wide" and "hard" do not train."""
SENSORS = {"tool": 1e-3, "goal_frame": 1e-3, "wrist": 0.05, "height_map": 1e-3, "depth": 2e-3, "scale": 1e-5}
"""Term -> standard deviation of its noise in "hard", in the term's unit."""
HARD_DELAY = 0.02
"""Time [s] by which commands are carried out later in "hard", from the camera to the drive."""


class Drawn(NamedTuple):
    """A number that can be drawn."""

    unit: str
    lowest: float
    highest: float
    meaning: str
    wide: tuple[float, float] | None = None
    """Its range in the preset "wide"."""
    needs: str = ""
    """"container" (or receiver), "loose grains" (in a container or a pile), "dose" or "arm"; empty: any task has it."""


NUMBERS = {
    "tool_friction": Drawn("1", 0.0, 10.0, "friction between grains and tool", (0.05, 0.3)),
    "container_friction": Drawn("1", 0.0, 10.0, "friction between grains and container", (0.3, 0.7), "container"),
    "tool_x": Drawn("m", -0.5, 0.5, "displacement of the tool's start along x", (-0.03, 0.03)),
    "tool_y": Drawn("m", -0.5, 0.5, "along y", (-0.03, 0.03)),
    "tool_z": Drawn("m", -0.5, 0.5, "along z", (-0.03, 0.03)),
    "tool_yaw_deg": Drawn("deg", -180.0, 180.0, "turn of the tool about the vertical at the start", (-20.0, 20.0)),
    "place_x": Drawn("m", -0.5, 0.5, "displacement of container, target and bounds along x", (-0.03, 0.03)),
    "place_y": Drawn("m", -0.5, 0.5, "along y", (-0.03, 0.03)),
    "place_yaw_deg": Drawn("deg", -180.0, 180.0, "their turn about the container's, or else the target's middle",
                           (-30.0, 30.0)),
    "fill": Drawn("1", 0.2, 3.0, "volume of the grains over the task's; one of three levels", (0.8, 1.2)),
    "surface_slope_deg": Drawn("deg", -40.0, 40.0, "slope of their surface along the container's x; one of three "
                               "levels", (-10.0, 10.0), "loose grains"),
    **{f"mount_{axis}": Drawn("m", -0.05, 0.05, f"error of the tool's place in the hand along its {axis}",
                              (-1e-3, 1e-3)) for axis in "xyz"},
    **{f"mount_{axis}_deg": Drawn("deg", -45.0, 45.0, f"error of its turn in the hand about its {axis}", (-0.5, 0.5))
       for axis in "xyz"},
    TARGET_MASS: Drawn("kg", 1e-3 * LEAST_DOSE, 1e-3 * LARGEST_DOSE, "mass to dose", None, "dose"),
    "stiffness": Drawn("1", 0.2, 3.0, "factor on the servo's stiffness", (0.9, 1.1), "arm"),
    "damping": Drawn("1", 0.2, 3.0, "factor on the servo's damping", (0.9, 1.1), "arm"),
    "payload": Drawn("1", 0.2, 5.0, "factor on mass and inertia of hand and tool, unknown to the controller",
                     (0.8, 1.2), "arm"),
}
"""Name -> what it is, besides the numbers of the material and those of sensors, "term.option"."""
HARDER = {"place_x": (-0.1, 0.1), "place_y": (-0.1, 0.1), "place_yaw_deg": (-45.0, 45.0), "fill": (0.5, 1.5)}
"""Ranges of the preset "hard" in place of those of "wide"."""
LEVELS = 3
"""Values of a number that needs a settled start of its own: both ends of the range and its middle."""
IN_LEVELS = ("fill", "surface_slope_deg")


def has(task: TaskConfig, needs: str, arm: bool) -> bool:
    """Return whether a task has what a number needs."""
    return {"container": bool(task.containers), "loose grains": not task.carried, "dose": task.dose is not None,
            "arm": arm}.get(needs, True)


def valid_numbers(task: TaskConfig, arm: bool) -> list[str]:
    """Return the names of NUMBERS that a task has."""
    return [name for name, drawn in NUMBERS.items() if has(task, drawn.needs, arm)]


def wide_ranges(task: TaskConfig, arm: bool = False) -> Ranges:
    """Return the ranges of the preset "wide" for a task.
    Friction of the tool: from polished to worn steel. Errors of the robot: those of `robosim.robot.model_errors`, as a
    laboratory identifies its own by hand."""
    return {MATERIAL: ("salt", "sugar", "sand", "flour")} | {
        name: drawn.wide for name, drawn in NUMBERS.items() if drawn.wide and has(task, drawn.needs, arm)}


def hard_ranges(task: TaskConfig, arm: bool = False, sensors: Collection[str] = ()) -> Ranges:
    """Return the ranges of the preset "hard" for a task; where a mass is dosed the fills are those of "wide".
    sensors: numbers that the observation has."""
    harder = {name: pair for name, pair in HARDER.items() if name != "fill" or task.dose is None}
    return {**wide_ranges(task, arm), **harder} | {
        f"{term}.noise": (noise, noise) for term, noise in SENSORS.items() if f"{term}.noise" in sensors}


def choose_ranges(given: str | Ranges | None, task: TaskConfig, arm: bool = False,
                  sensors: Collection[str] = ()) -> Ranges:
    """Return the ranges of an environment: a preset's, those of a .yaml file, those given, or else the task's own.
    The mass to dose is drawn with any of them. Raises UnknownName for a preset that does not exist, ConfigError for a
    file that cannot be used."""
    low, high = task.dose.target_g if task.dose is not None else (0.0, 0.0)
    target = {} if task.dose is None else {TARGET_MASS: (1e-3 * low, 1e-3 * high)}
    if given is None:
        return target | task.randomize
    if isinstance(given, str) and given.endswith((".yaml", ".yml")):
        path, given = given, read(Path(given))
        if not isinstance(given, dict):
            raise ConfigError(f"{path}: holds {given!r:.100}; accepted: a table of name: [lowest, highest]")
    if not isinstance(given, str):
        return target | dict(given)
    if given not in PRESETS:
        raise UnknownName("randomize", given, PRESETS, "or ranges: name -> (lowest, highest), or a .yaml file of them")
    if given in HARD:
        unseen = {MATERIAL: UNSEEN} if given == "hard_unseen" else {}
        return {**target, **hard_ranges(task, arm, sensors), **unseen}
    return target | dict(wide_ranges(task, arm)) if given == "wide" else target

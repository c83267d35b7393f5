"""The ranges of an environment, and the draws from them."""

import copy
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import mpm
from mpm.geometry.rigid_motion import rotate
from robosim.base.errors import ConfigError, UnknownName
from robosim.config.materials import Law, MaterialConfig, number_names, overridden
from robosim.randomization.materials import find_material
from robosim.randomization.ranges import IN_LEVELS, LEVELS, MATERIAL, NUMBERS, Ranges, valid_numbers
from robosim.randomization.variants import check_fill, displacement, filled
from robosim.scene.field import choose_substep
from robosim.scene.grains import grain_volume
from robosim.tasks.draw import HOME, Draw, Setting, Vector
from robosim.tasks.outcome import load_mass
from robosim.tasks.sections import TARGET_MASS
from robosim.tasks.task import TaskConfig

Domains = Mapping[str, tuple[float, float]]
"""Number of a sensor, "term.option" -> its lowest and highest value."""
PLACES = ("place_x", "place_y", "place_yaw_deg")
MOUNTS, MOUNT_TURNS = [[f"mount_{axis}{unit}" for axis in "xyz"] for unit in ("", "_deg")]


class Randomization:
    """Ranges of what differs between the episodes of a task, and the draws from them.

    arm: whether an arm carries the tool. sensors: numbers of the observation's terms that can be drawn. volume: of a
    grain [m^3] that was handed over; None: the task's own.
    Raises UnknownName for a number or material that there is not, ConfigError for a pair that is no range, leaves the
    domain of the number, or needs a smaller time step than the material in the file."""

    def __init__(self, task: TaskConfig, material: MaterialConfig, ranges: Ranges, *, arm: bool = False,
                 sensors: Domains | None = None, volume: float | None = None) -> None:
        self._task, self._sensors = task, sensors or {}
        self.materials = {label: find_material(label) for label in ranges.get(MATERIAL, ())}
        self._own = material
        self._numbers = set.intersection(*[set(number_names(one)) for one in [material, *self.materials.values()]])
        for label, one in self.materials.items():
            if type(one) is not type(material):
                raise ConfigError(f"randomize: material {label!r} has the law of {type(one).__name__}; accepted: "
                                  f"that of the environment's own, {type(material).__name__}")
        self.ranges: dict[str, tuple[float, float]] = {
            name: self._read_range(name, pair, arm) for name, pair in ranges.items() if name != MATERIAL}
        self._laws = {label: one.make_law() for label, one in self.materials.items()}
        self._levels = {name: self.levels(name) for name in self.ranges if name in IN_LEVELS}
        for fill, slope in itertools.product(self.levels("fill"), self.levels("surface_slope_deg")):
            check_fill(task, fill or 1.0, slope)
        self.step = self._common_step()
        """Substep [s] that every material of an episode allows; None where none is drawn."""
        self._check_target(volume)

    def _read_range(self, name: str, pair: Any, arm: bool) -> tuple[float, float]:
        valid = [MATERIAL, *sorted(self._numbers), *valid_numbers(self._task, arm), *self._sensors]
        if name not in valid:
            raise UnknownName("number in randomize", name, valid)
        try:
            low, high = (float(value) for value in pair)
        except (TypeError, ValueError):
            low, high = math.nan, math.nan
        if not low <= high:
            raise ConfigError(f"randomize: {name} = {pair!r}; accepted: (lowest, highest)")
        least, most = NUMBERS[name][1:3] if name in NUMBERS else self._sensors.get(name, (-math.inf, math.inf))
        if not least <= low <= high <= most:
            raise ConfigError(f"randomize: {name} = {pair!r}; accepted: {least:g} to {most:g}")
        return low, high

    def _common_step(self) -> float | None:
        own = {name: pair for name, pair in self.ranges.items() if name in self._numbers}
        if not own and not self.materials:
            return None
        fullest = filled(self._task, max(self.levels("fill")) or 1.0)  # whose grains are the largest
        return min(choose_substep(fullest, overridden(material, dict(zip(own, corner))).make_law())
                   for material in [self._own, *self.materials.values()]
                   for corner in itertools.product(*own.values()))

    def _check_target(self, handed_over: float | None) -> None:
        """Raise ConfigError for a mass to dose above what the tool holds; handed_over: volume of a grain [m^3]."""
        for material in [self._own, *self.materials.values()] if TARGET_MASS in self.ranges else ():
            density = min(self.ranges["density"]) if "density" in self.ranges else material.make_law().density
            for fill in self.levels("fill"):
                volume = handed_over or grain_volume(filled(self._task, fill or 1.0))
                mass, has = load_mass(self._task, density, volume)
                if self.ranges[TARGET_MASS][1] > mass:
                    raise ConfigError(f"target mass of up to {1e3 * self.ranges[TARGET_MASS][1]:.3g} g: {has} "
                                      f"{1e3 * mass:.3g} g of {density:g} kg/m^3; accepted: at most that, as "
                                      f"dose.target_g or in randomize as {TARGET_MASS} [kg]")

    @property
    def moves_places(self) -> bool:
        """Whether container, target and bounds are displaced."""
        return any(name in self.ranges for name in PLACES)

    @property
    def varies_grains(self) -> bool:
        """Whether episodes begin from different settled starts."""
        return bool(self.materials) or any(name in self.ranges for name in IN_LEVELS)

    def levels(self, name: str) -> list[float]:
        """Return the values that a number in levels has."""
        low, high = self.ranges.get(name, (0.0, 0.0))
        return [float(value) for value in np.linspace(low, high, LEVELS)] if low < high else [low]

    def draw(self, rng: np.random.Generator, *, nominal: bool, shift: Vector, turn_deg: float) -> Draw:
        """Draw an episode; nominal: the tool and the pile begin where the task says, but for shift [m] and turn."""
        own = [name for name in self.ranges if name in NUMBERS and NUMBERS[name].needs == "arm"]
        numbers = {name: _pick(rng, self._levels[name]) if name in IN_LEVELS else rng.uniform(*pair)
                   for name, pair in self.ranges.items() if name not in self._sensors and name not in own}
        tool, pile = np.array(shift), np.zeros(3)
        if not nominal:
            tool = tool + rng.uniform(-1.0, 1.0, 3) * self._task.start.spread
            pile = rng.uniform(-1.0, 1.0, 3) * self._task.start.pile_spread
            turn_deg = turn_deg + numbers.get("tool_yaw_deg", 0.0)
            tool = tool + [numbers.get(f"tool_{axis}", 0.0) for axis in "xyz"]
        material = _pick(rng, list(self.materials)) if self.materials else ""
        numbers |= {name: rng.uniform(*self.ranges[name]) for name in own}  # last: a tool alone has the same start
        rng = copy.deepcopy(rng)  # so that neither this start nor those that follow depend on sensors
        seed = int(rng.integers(2**62))
        numbers |= {name: rng.uniform(*pair) for name, pair in self.ranges.items() if name in self._sensors}
        return Draw(numbers, three(tool), three(pile), turn_deg, seed, material)

    def read(self, given: Any) -> Draw:
        """Return the draw that `reset` is given back; raises ConfigError for what these ranges cannot have drawn."""
        try:
            draw = Draw(**{**given, "numbers": {name: float(value) for name, value in given["numbers"].items()},
                           "tool": three(given["tool"]), "pile": three(given["pile"]),
                           "turn_deg": float(given["turn_deg"]), "sensors": int(given["sensors"])})
            is_usable = set(draw.numbers) == set(self.ranges) and draw.sensors >= 0 and all(
                math.isfinite(value) for value in (*draw.numbers.values(), *draw.tool, *draw.pile, draw.turn_deg))
            is_usable &= draw.material in (self.materials or {""})
        except (TypeError, ValueError, KeyError, AttributeError):
            is_usable, draw = False, Draw({})
        if not is_usable:
            raise ConfigError(f"options of reset: draw = {given!r:.200}; accepted: info['draw'] of an environment with "
                              f"randomize = {self.describe()}")
        for name, value in draw.numbers.items():
            low, high = self.ranges[name]
            if not low <= value <= high:
                raise ConfigError(f"options of reset: draw: {name} = {value}; accepted: {low} to {high}")
            if name in IN_LEVELS and value not in self.levels(name):
                raise ConfigError(f"options of reset: draw: {name} = {value}; accepted: {self.levels(name)}")
        return draw

    def describe(self) -> dict[str, Any]:
        """Return the ranges as plain values."""
        return {**{name: list(pair) for name, pair in self.ranges.items()},
                **({MATERIAL: list(self.materials)} if self.materials else {})}

    def material(self, draw: Draw) -> MaterialConfig:
        """Return the material that an episode's grains settle in: without the numbers that are drawn."""
        return self.materials.get(draw.material, self._own)

    def law(self, draw: Draw) -> Law | None:
        """Return the law of an episode; None: neither material nor one of its numbers is drawn."""
        numbers = {name: value for name, value in draw.numbers.items() if name in self._numbers}
        if not numbers:
            return self._laws.get(draw.material)
        return overridden(self.material(draw), numbers).make_law()

    def frictions(self, draw: Draw, colliders: int) -> dict[int, float]:
        """Return the friction of each collider whose friction is drawn, by its number; the tool's is 0."""
        found = {0: draw.numbers["tool_friction"]} if "tool_friction" in draw.numbers else {}
        if "container_friction" in draw.numbers:
            found |= dict.fromkeys(range(1, colliders), draw.numbers["container_friction"])
        return found

    def grains(self, draw: Draw) -> TaskConfig:
        """Return the task with the fill of an episode."""
        return filled(self._task, draw.grains[1])

    def setting(self, draw: Draw) -> Setting:
        """Return how the scene of an episode differs from the task's."""
        place, shift, turn = ([draw.numbers.get(name, 0.0) for name in names]
                              for names in (PLACES, MOUNTS, MOUNT_TURNS))
        quaternion = rotate(mpm.Pose.identity().quaternion, np.radians(turn))
        factors = {name: draw.numbers.get(name, 1.0) for name in ("stiffness", "damping", "payload")}
        factors["target_mass"] = draw.numbers.get(TARGET_MASS, 0.0)
        return Setting(displacement(self._task, *place) if any(place) else HOME,
                       mpm.Pose(np.array(shift), quaternion) if any((*shift, *turn)) else HOME, **factors)

    def sensors(self, draw: Draw) -> dict[str, float]:
        """Return the numbers of sensors that are drawn."""
        return {name: value for name, value in draw.numbers.items() if name in self._sensors}


def three(values: Any) -> Vector:
    """Return three numbers as floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def _pick(rng: np.random.Generator, values: Sequence[Any]) -> Any:
    """Return one of the values, as `rng.choice` does, in a tenth of its time."""
    return values[int(rng.integers(len(values)))]

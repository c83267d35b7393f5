"""What episodes draw at random: numbers of the material, frictions, and where tool and pile begin."""

import copy
import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mpm.materials.stable_step import accepted_bound
from robosim.config.materials import Law, MaterialConfig, law_of, number_names, overridden
from robosim.errors import ConfigError, UnknownName
from robosim.tasks.field import largest_step
from robosim.tasks.task import TaskConfig

Ranges = dict[str, tuple[float, float]]
"""Number of the material, or friction -> its lowest and highest value."""
Vector = tuple[float, float, float]
FRICTIONS = ("tool_friction", "container_friction")
"""What is drawn besides numbers of the material; `container_friction` for tasks with a container."""
MOST_FRICTION = 10.0


class Draw(NamedTuple):
    """All that is random in an episode; `info["draw"]` of a reset has it as a dictionary."""

    numbers: dict[str, float]
    """Value of everything with a range."""
    tool: Vector = (0.0, 0.0, 0.0)
    """Displacement [m] of the tool from the task's start."""
    pile: Vector = (0.0, 0.0, 0.0)
    """Displacement [m] of grains that are not in the tool."""
    turn_deg: float = 0.0
    """Turn of the tool about the vertical."""
    sensors: int = 0
    """Seed of what is random in sensors."""


class Randomization:
    """Ranges of a task's numbers, and the draws from them.

    Raises UnknownName for a number that there is not, ConfigError for a pair that is no range, leaves the domain of the
    number, or needs a smaller time step.
    """

    def __init__(self, task: TaskConfig, material: MaterialConfig, ranges: Mapping[str, tuple[float, float]]) -> None:
        self._task, self._material = task, material
        self.ranges: Ranges = dict(ranges)
        for name, pair in ranges.items():
            self._check_range(name, pair)
        dt = largest_step(task, law_of(material))
        own = {name: pair for name, pair in ranges.items() if name not in FRICTIONS}
        for corner in itertools.product(*own.values()):
            numbers = dict(zip(own, corner))
            bound = accepted_bound(task.field.cell, law_of(overridden(material, numbers)))
            if dt > bound:
                raise ConfigError(f"randomize: {numbers} needs a time step of {bound:.3g} s; this has {dt:.3g} s: "
                                  f"take a softer or a heavier material")

    def _check_range(self, name: str, pair: Any) -> None:
        valid = [*number_names(self._material), *FRICTIONS[: 2 if self._task.containers else 1]]
        if name not in valid:
            raise UnknownName("number in randomize", name, valid)
        low, high = pair if np.ndim(pair) == 1 and len(pair) == 2 else (math.nan, math.nan)
        if not low <= high:
            raise ConfigError(f"randomize: {name} = {pair!r}; accepted: (lowest, highest)")
        if name in FRICTIONS and not 0.0 <= low <= high <= MOST_FRICTION:
            raise ConfigError(f"randomize: {name} = {pair!r}; accepted: 0 to {MOST_FRICTION:g}")

    def draw(self, rng: np.random.Generator, *, nominal: bool, shift: Vector, turn_deg: float) -> Draw:
        """Draw an episode; nominal: the tool and the pile begin where the task says, but for shift [m] and turn."""
        numbers = {name: float(rng.uniform(*pair)) for name, pair in self.ranges.items()}
        tool, pile = np.array(shift), np.zeros(3)
        if not nominal:
            tool = tool + rng.uniform(-1.0, 1.0, 3) * self._task.start.spread
            pile = rng.uniform(-1.0, 1.0, 3) * self._task.start.pile_spread
        # of a copy, so that the starts that follow do not depend on sensors
        return Draw(numbers, three(tool), three(pile), turn_deg, int(copy.deepcopy(rng).integers(2**62)))

    def read(self, given: Any) -> Draw:
        """Return the draw that an option of `reset` gives back.

        Raises ConfigError for what no environment with these ranges has drawn.
        """
        try:
            draw = Draw(**{**given, "numbers": {name: float(value) for name, value in given["numbers"].items()},
                           "tool": three(given["tool"]), "pile": three(given["pile"]),
                           "turn_deg": float(given["turn_deg"]), "sensors": int(given["sensors"])})
            is_usable = set(draw.numbers) == set(self.ranges) and draw.sensors >= 0 and all(
                math.isfinite(value) for value in (*draw.numbers.values(), *draw.tool, *draw.pile, draw.turn_deg))
        except (TypeError, ValueError, KeyError, AttributeError):
            is_usable, draw = False, Draw({})
        if not is_usable:
            raise ConfigError(f"options of reset: draw = {given!r:.200}; accepted: info['draw'] of an environment with "
                              f"randomize = {self.ranges}")
        for name, value in draw.numbers.items():
            low, high = self.ranges[name]
            if not low <= value <= high:
                raise ConfigError(f"options of reset: draw: {name} = {value}; accepted: {low} to {high}")
        return draw

    def law(self, draw: Draw) -> Law | None:
        """Return the material of an episode; None: none of its numbers is drawn."""
        numbers = {name: value for name, value in draw.numbers.items() if name not in FRICTIONS}
        return law_of(overridden(self._material, numbers)) if numbers else None

    def frictions(self, draw: Draw, colliders: int) -> dict[int, float]:
        """Return the friction of each collider whose friction is drawn, by its number; the tool's is 0."""
        found = {0: draw.numbers["tool_friction"]} if "tool_friction" in draw.numbers else {}
        if "container_friction" in draw.numbers:
            found |= dict.fromkeys(range(1, colliders), draw.numbers["container_friction"])
        return found


def three(values: Any) -> Vector:
    """Return three numbers as floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z

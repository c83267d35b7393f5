"""Conditions at the six sides of the grid, and the table in which kernels read them."""

from dataclasses import dataclass

import numpy as np

from mpm.errors import InvalidValue, UnknownName
from mpm.scene.grid import GHOST, Grid
from mpm.scene.wall_condition import WALL_PARAMETERS, Friction, Roller, Slip, Stick, WallCondition, check_condition

Side = str | WallCondition
Sides = tuple[Side, Side, Side]
PERIODIC = "periodic"
NAMED: dict[str, WallCondition] = {"slip": Slip(), "roller": Roller(), "stick": Stick()}
"""Name -> condition without a number of its own."""
NAMES = ("friction", PERIODIC, *NAMED)
"""Names that a side may be given."""
WALL_COUNT, WALL_COLUMNS = 6, 5
"""Shape of `wall_table`."""
IS_PERIODIC, IS_FREE = -1, -2
"""Instead of the place of a condition: a periodic side; a column that leaves a wall, whatever its condition."""


@dataclass(frozen=True, kw_only=True)
class Walls:
    """Boundary conditions at the six sides of the grid.

    - "friction": Coulomb friction; material can leave the wall.
    - "slip": no friction; material can leave the wall.
    - "roller": zero normal velocity, no friction.
    - "stick": zero velocity.
    - "periodic": particles that leave on one side enter on the other; colliders are not repeated.

    Or a condition of your own, see `mpm.scene.wall_condition.WallCondition`."""

    friction: float = 0.5
    """Friction coefficient of the sides with the condition "friction"."""
    lower: Sides = ("friction", "friction", "friction")
    """Conditions at the lower x, y and z walls."""
    upper: Sides = ("friction", "friction", "friction")
    """Conditions at the upper x, y and z walls."""

    @classmethod
    def all(cls, condition: Side, friction: float = 0.5) -> "Walls":
        """Make walls with the same condition at all six sides."""
        sides = (condition, condition, condition)
        return cls(friction=friction, lower=sides, upper=sides)

    def __post_init__(self) -> None:
        if not self.friction >= 0:
            raise InvalidValue(f"Walls: friction = {self.friction}; accepted: 0 or more")
        for end, sides in (("lower", self.lower), ("upper", self.upper)):
            if len(sides) != 3:
                raise InvalidValue(f"Walls: {end} has {len(sides)} conditions; accepted: 3")
            for axis, condition in zip("xyz", sides):
                if not isinstance(condition, str):
                    check_condition(f"{end} {axis}", condition)
                elif condition not in NAMES:
                    raise UnknownName("wall condition", condition, NAMES)
        for axis, pair in zip("xyz", zip(self.lower, self.upper)):
            if PERIODIC in pair and pair[0] != pair[1]:
                raise InvalidValue(f"Walls: {axis} is {pair[0]} and {pair[1]}; both sides are periodic or none")

    @property
    def periodic(self) -> tuple[bool, bool, bool]:
        """Whether each axis is periodic."""
        x, y, z = (condition == PERIODIC for condition in self.lower)
        return x, y, z

    def check(self, grid: Grid) -> None:
        """Raise InvalidValue when two walls are closer than two cells: their mirror images would meet."""
        for axis, cells, periodic in zip("xyz", grid.cells, self.periodic):
            if cells < 2 and not periodic:
                raise InvalidValue(f"Grid: one cell along {axis} between walls; accepted: 2 or more, or periodic sides")

    @property
    def in_order(self) -> list[WallCondition | None]:
        """Conditions of the six sides in the order of folding: x lower, x upper, y lower ...; None: periodic."""
        named = {**NAMED, "friction": Friction(coefficient=self.friction)}
        sides = [side for pair in zip(self.lower, self.upper) for side in pair]
        return [named.get(side) if isinstance(side, str) else side for side in sides]


def conditions_of(walls: Walls) -> list[WallCondition]:
    """Return a condition of each class that the walls use: what is compiled once a class."""
    return list({type(condition): condition for condition in walls.in_order if condition is not None}.values())


def wall_table(walls: Walls, grid: Grid) -> np.ndarray:
    """Return the six sides (WALL_COUNT, WALL_COLUMNS) in the order of folding.
    Columns: axis, last plane of nodes, inward sign, place of its condition in `conditions_of`, whether material may
    leave.
    On a periodic axis the last node above is the one before the wall: the wall's own plane is the image of the first.
    """
    classes = [type(condition) for condition in conditions_of(walls)]
    rows = []
    for side, condition in enumerate(walls.in_order):
        axis, is_upper = divmod(side, 2)
        node = GHOST + int(grid.cells[axis]) - walls.periodic[axis] if is_upper else GHOST
        kind = IS_PERIODIC if condition is None else classes.index(type(condition))
        rows.append((axis, node, -1 if is_upper else 1, kind, condition is None or condition.separable))
    return np.array(rows, np.int32)


def wall_numbers(walls: Walls) -> np.ndarray:
    """Return the numbers of the six sides' conditions (6, WALL_PARAMETERS), in the order of folding."""
    numbers = np.zeros((WALL_COUNT, WALL_PARAMETERS))
    for side, condition in enumerate(walls.in_order):
        if condition is not None:
            numbers[side, : len(condition.parameters)] = condition.parameters
    return numbers

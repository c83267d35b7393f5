"""Conditions at the six sides of the grid, and the table in which kernels read them."""

from dataclasses import dataclass

import numpy as np

from mpm.errors import InvalidValue, UnknownName
from mpm.scene.grid import GHOST, Grid

FRICTION, SLIP, ROLLER, STICK, PERIODIC = range(5)
CONDITIONS = {"friction": FRICTION, "slip": SLIP, "roller": ROLLER, "stick": STICK, "periodic": PERIODIC}
Sides = tuple[str, str, str]


@dataclass(frozen=True, kw_only=True)
class Walls:
    """Boundary conditions at the six sides of the grid.

    - "friction": Coulomb friction; material can leave the wall.
    - "slip": no friction; material can leave the wall.
    - "roller": zero normal velocity, no friction.
    - "stick": zero velocity.
    - "periodic": particles that leave on one side enter on the other; colliders are not repeated.
    """

    friction: float = 0.5
    """Friction coefficient of the sides with the condition "friction"."""
    lower: Sides = ("friction", "friction", "friction")
    """Conditions at the lower x, y and z walls."""
    upper: Sides = ("friction", "friction", "friction")
    """Conditions at the upper x, y and z walls."""

    @classmethod
    def all(cls, condition: str, friction: float = 0.5) -> "Walls":
        """Make walls with the same condition at all six sides."""
        sides = (condition, condition, condition)
        return cls(friction=friction, lower=sides, upper=sides)

    def __post_init__(self) -> None:
        for condition in (*self.lower, *self.upper):
            if condition not in CONDITIONS:
                raise UnknownName("wall condition", condition, CONDITIONS)
        for axis, pair in zip("xyz", zip(self.lower, self.upper)):
            if "periodic" in pair and pair[0] != pair[1]:
                raise InvalidValue(f"Walls: {axis} is {pair[0]} and {pair[1]}; both sides are periodic or none")
        if not self.friction >= 0:
            raise InvalidValue(f"Walls: friction = {self.friction}; accepted: 0 or more")

    @property
    def periodic(self) -> tuple[bool, bool, bool]:
        """Whether each axis is periodic."""
        x, y, z = (condition == "periodic" for condition in self.lower)
        return x, y, z

    def check(self, grid: Grid) -> None:
        """Raise InvalidValue when two walls are closer than two cells: their mirror images would meet."""
        for axis, cells, periodic in zip("xyz", grid.cells, self.periodic):
            if cells < 2 and not periodic:
                raise InvalidValue(f"Grid: one cell along {axis} between walls; accepted: 2 or more, or periodic sides")


def wall_table(walls: Walls, grid: Grid) -> np.ndarray:
    """Return the six sides (6, 4) in the order of folding: axis, last plane of nodes, inward sign, condition.

    On a periodic axis the last node above is the one before the wall: the wall's own plane is the image of the first.
    """
    rows = []
    for axis in range(3):
        upper = GHOST + int(grid.cells[axis]) - walls.periodic[axis]
        rows.append((axis, GHOST, 1, CONDITIONS[walls.lower[axis]]))
        rows.append((axis, upper, -1, CONDITIONS[walls.upper[axis]]))
    return np.array(rows, np.int32)

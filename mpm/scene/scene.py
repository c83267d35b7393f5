"""What is simulated, and how: bodies, colliders and walls on a grid, and the numerics of the solver."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from mpm.backend import PRECISIONS, session_precision
from mpm.errors import InvalidValue, UnknownName
from mpm.materials.hencky_strain import INTEGRATORS
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.grid import Grid
from mpm.scene.validation import check_finite, describe
from mpm.scene.walls import Walls

Interval = float | Literal["strides"] | None  # accepted values of `Numerics.transfer_interval`
LARGEST_SLEEP = 100.0  # largest accepted value of `Numerics.sleep`
DOWN = (0.0, 0.0, -9.81)  # default gravity [m/s^2]


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """How a scene is advanced, see `mpm.Solver`; raises InvalidValue, UnknownName."""

    dt: float | None = None
    precision: str | None = None
    integrator: str | None = None
    transfer_interval: Interval = None
    sleep: bool | float = False

    def __post_init__(self) -> None:
        is_number = isinstance(self.sleep, int | float | np.number) and not isinstance(self.sleep, bool | np.bool_)
        if not isinstance(self.sleep, bool | np.bool_) and not (is_number and 0 < self.sleep <= LARGEST_SLEEP):
            raise InvalidValue(f"Solver: sleep = {self.sleep!r}; accepted: False, True (1), or a factor on its "
                               f"thresholds, above 0, at most {LARGEST_SLEEP:g}")

    def chosen(self, bodies: list[Body]) -> "Numerics":
        """Return the numerics with precision and integrator chosen for a scene's bodies; starts the backend."""
        session = session_precision()
        precision = self.precision or session
        if precision not in PRECISIONS:
            raise UnknownName("precision", self.precision, PRECISIONS)
        if not bodies:
            raise InvalidValue("Solver: bodies is empty; give at least one Body")
        takes_logarithms = any(body.material.state == "hencky" for body in bodies)
        integrator = self.integrator or ("auto" if precision == "f32" and takes_logarithms else "exact")
        if integrator not in INTEGRATORS:
            raise UnknownName("integrator", self.integrator, INTEGRATORS)
        return replace(self, precision=precision, integrator=integrator)


@dataclass(eq=False)
class Scene:
    """Grid, bodies, colliders, walls and gravity; raises InvalidValue for arguments of other types."""

    grid: Grid
    bodies: list[Body]
    colliders: list[Collider] = field(default_factory=list)
    walls: Walls = field(default_factory=Walls)
    gravity: np.ndarray = field(default_factory=lambda: np.array(DOWN))

    def __post_init__(self) -> None:
        for name, accepted, kind in (("grid", "mpm.Grid(lower, upper, cell)", Grid),
                                     ("walls", 'mpm.Walls, such as mpm.Walls.all("slip"), or None', Walls)):
            if not isinstance(getattr(self, name), kind):
                raise InvalidValue(f"Solver: {name} = {describe(getattr(self, name))}; accepted: {accepted}")
        _check_list("bodies", self.bodies, Body)
        check_colliders(self.colliders)
        self.bodies, self.colliders = list(self.bodies), list(self.colliders)
        for body in self.bodies:
            self.grid.check_inside(np.asarray(body.positions, float))
        self.walls.check(self.grid)
        self.gravity = check_finite("Solver: gravity", self.gravity, (3,))


def check_colliders(colliders: Sequence[Collider]) -> None:
    """Raise InvalidValue for anything but a list of colliders."""
    _check_list("colliders", colliders, Collider)


def _check_list(name: str, given: object, kind: type) -> None:
    """Raise InvalidValue for anything but a list of a kind."""
    if not isinstance(given, list | tuple):
        raise InvalidValue(f"Solver: {name} = {describe(given)}; accepted: a list of mpm.{kind.__name__}")
    for place, one in enumerate(given):
        if not isinstance(one, kind):
            raise InvalidValue(f"Solver: {name}[{place}] = {describe(one)}; accepted: mpm.{kind.__name__}")

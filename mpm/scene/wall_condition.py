"""The protocol of a wall condition: what a side of the grid must offer; and the bundled conditions."""

import inspect
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mpm.backend import ti
from mpm.errors import InvalidValue

WALL_PARAMETERS = 4
"""The most numbers that a wall condition may hand to the kernels."""
SMALLEST_MOMENTUM = 1e-37
"""Smallest momentum [N s] to divide by: above the numbers that lose digits in single precision."""


class WallCondition(Protocol):
    """A condition of a wall: a frozen dataclass of numbers, and static Taichi functions that kernels call.

    The field reverses the normal velocity in the mirror image and stops it on the wall. A condition decides about the
    tangential part and whether material may leave. Vectors have four entries, x, y, z and a fourth, 0; `p` holds the
    numbers of `parameters` in their order. Conditions of one class are compiled once. A belt takes ten lines:

        @dataclass(frozen=True, kw_only=True)
        class Belt(Friction):
            velocity: tuple[float, float, float]

            @property
            def parameters(self):
                return (self.coefficient, *self.velocity)

            @staticmethod
            @ti.func
            def slide(t, n, mass, push, dt, p):
                belt = ti.Vector([p[1], p[2], p[3], 0.0])
                return belt + Friction.slide(t - belt, n, mass, push, dt, p)

    `mpm.Walls(lower=("slip", "slip", Belt(coefficient=0.5, velocity=(0.2, 0, 0))))` then has a belt as its floor.
    Besides the members below a condition has:

    mirror(t, mass, p) -> tangential part of the mirror image of a momentum with the tangential part t [kg m/s], of a
        node of this mass [kg]; of a velocity [m/s] with mass 1. t where material slides, -t where it sticks. Applied
        twice it gives back t.
    slide(t, n, mass, push, dt, p) -> tangential velocity [m/s] that a node on the wall keeps, from t before. n: inward
        normal; mass: of the node [kg]; push: impulse [N s], 0 or more, with which the wall pushes in this substep of
        dt [s].
    slide_back(t, n, mass, push, dt, p, bar) -> (t_bar, mass_bar, push_bar): the adjoint of `slide`, which only
        differentiable rollouts need. That of `mirror` follows from `mirror`."""

    @property
    def separable(self) -> bool:
        """Whether material that pulls may leave the wall."""
        ...

    @property
    def parameters(self) -> tuple[float, ...]:
        """Numbers that the kernels read, at most `WALL_PARAMETERS`."""
        ...


@dataclass(frozen=True, kw_only=True)
class Slip:
    """Material may leave the wall; no friction."""

    separable = True

    @property
    def parameters(self) -> tuple[float, ...]:
        """None."""
        return ()

    @staticmethod
    @ti.func
    def mirror(t, mass, p):
        """Return the tangential part of the mirror image."""
        return t

    @staticmethod
    @ti.func
    def slide(t, n, mass, push, dt, p):
        """Return the tangential velocity [m/s] that a node on the wall keeps."""
        return t

    @staticmethod
    @ti.func
    def slide_back(t, n, mass, push, dt, p, bar):
        """Return the adjoints of t, mass and push."""
        return bar, 0.0 * mass, 0.0 * push


@dataclass(frozen=True, kw_only=True)
class Roller(Slip):
    """The normal velocity is zero for good; no friction."""

    separable = False


@dataclass(frozen=True, kw_only=True)
class Stick(Slip):
    """The velocity is zero."""

    separable = False

    @staticmethod
    @ti.func
    def mirror(t, mass, p):
        return -t

    @staticmethod
    @ti.func
    def slide(t, n, mass, push, dt, p):
        return 0.0 * t

    @staticmethod
    @ti.func
    def slide_back(t, n, mass, push, dt, p, bar):
        return 0.0 * bar, 0.0 * mass, 0.0 * push


@dataclass(frozen=True, kw_only=True)
class Friction(Slip):
    """Material may leave the wall; Coulomb friction."""

    coefficient: float
    """Coulomb coefficient [-]."""

    def __post_init__(self) -> None:
        if not self.coefficient >= 0:
            raise InvalidValue(f"{type(self).__name__}: coefficient = {self.coefficient}; accepted: 0 or more")

    @property
    def parameters(self) -> tuple[float, ...]:
        """(coefficient)."""
        return (self.coefficient,)

    @staticmethod
    @ti.func
    def slide(t, n, mass, push, dt, p):
        # the momentum of a node at the very edge of a stencil can underflow
        return ti.max(1.0 - p[0] * push / ti.max(mass * t.norm(1e-15), SMALLEST_MOMENTUM), 0.0) * t

    @staticmethod
    @ti.func
    def slide_back(t, n, mass, push, dt, p, bar):
        t_bar, mass_bar, push_bar = bar, 0.0 * mass, 0.0 * push
        speed = t.norm(1e-15)
        left = 1.0 - p[0] * push / ti.max(mass * speed, SMALLEST_MOMENTUM)
        t_bar = ti.max(left, 0.0) * bar
        if left > 0 and mass * speed > SMALLEST_MOMENTUM:
            push_bar = -p[0] * t.dot(bar) / (mass * speed)
            mass_bar = -push_bar * push / mass
            t_bar -= push_bar * push / (speed * speed) * t
        return t_bar, mass_bar, push_bar


def check_condition(where: str, condition: Any) -> None:
    """Raise InvalidValue for an object that lacks what `WallCondition` asks for.
    where: its side, for the message."""
    name = condition.__name__ + " (a class)" if isinstance(condition, type) else type(condition).__name__
    missing = [member for member in ("separable", "parameters", "mirror", "slide") if not hasattr(condition, member)]
    accepted = "accepted: the name of a condition, or one as mpm.scene.wall_condition.WallCondition describes it"
    if missing or isinstance(condition, type):
        reason = f"has no {', '.join(missing)}" if missing else "is not an instance"
        raise InvalidValue(f"Walls: {where}: {name} {reason}; {accepted}")
    for member in ("mirror", "slide", "slide_back"):
        function = inspect.getattr_static(condition, member, None)
        is_static = isinstance(function, staticmethod) and getattr(function.__func__, "_is_taichi_function", False)
        if not is_static and hasattr(condition, member):
            raise InvalidValue(f"Walls: {where}: {name}.{member} is not a static Taichi function (@staticmethod, "
                               f"@ti.func); {accepted}")
    if not isinstance(condition.separable, bool):
        raise InvalidValue(f"Walls: {where}: {name}.separable = {condition.separable!r}; accepted: True or False")
    numbers = np.asarray(condition.parameters, float)
    if numbers.ndim != 1 or len(numbers) > WALL_PARAMETERS or not np.isfinite(numbers).all():
        raise InvalidValue(f"Walls: {where}: {name}.parameters = {condition.parameters!r}; accepted: at most "
                           f"{WALL_PARAMETERS} finite numbers")

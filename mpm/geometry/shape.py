"""The protocol of a signed-distance shape: what a solid must offer to contact."""

import hashlib
import weakref
from collections.abc import Hashable
from typing import Any

import numpy as np

from mpm.backend import Group, allocating, free_later, ti
from mpm.errors import InvalidValue

DIFFERENCE = 1e-6
"""Step [m] to each side of a point of the central differences for a shape without derivatives of its own."""
KINK = 10.0
"""Ratio of the differences to both sides, and curvature [1/m], beyond which one of them crosses an edge."""


def check_sizes(owner: str, name: str, sizes: object, count: int = 1, least: float = 0.0) -> tuple[float, ...]:
    """Return `count` lengths [m]; raise InvalidValue unless there are so many, finite and above `least`.
    owner, name: whose lengths, and what they are called, for the message."""
    try:
        values = tuple(float(size) for size in np.ravel(sizes))  # pyright: ignore[reportCallIssue, reportArgumentType]
    except (TypeError, ValueError):
        values = ()
    if len(values) != count or not all(least < value < np.inf for value in values):
        kind = "a positive length" if least >= 0.0 else "a length of 0 or more"
        accepted = kind if count == 1 else f"{count} positive lengths"
        raise InvalidValue(f"{owner}: {name} = {sizes} m; accepted: {accepted}")
    return values


def sign(shape: Any, *others: Hashable) -> Hashable:
    """Return the signature of a shape by those of its attributes that are numbers, or tuples of them.
    others: what stands for the attributes that are not; without it, a shape that has such is known by itself alone."""
    given = {name: value for name, value in vars(shape).items() if name != "group"}
    numbers = tuple((name, value) for name, value in sorted(given.items()) if isinstance(value, float | int | tuple))
    if not others and len(numbers) < len(given):
        return shape
    return type(shape), numbers, others


def digest(values: np.ndarray) -> str:
    """Return what stands for the values of an array in a signature."""
    return hashlib.sha256(repr((values.shape, values.dtype)).encode() + values.tobytes()).hexdigest()


class Shape:
    """Base of all solids: a signed distance in the frame of its collider, negative inside, in metres.

    A solid has `radius` [m], of a ball about the frame's origin that contains it (contact looks no farther), a Taichi
    function `at` and its twin on the host, `distance`; the other members have defaults. A torus takes ten lines:

        class Torus(Shape):
            def __init__(self, ring: float, tube: float) -> None:
                self.ring, self.tube, self.radius = ring, tube, ring + tube

            @ti.func
            def at(self, y):
                around = ti.sqrt(y[0] * y[0] + y[1] * y[1] + 1e-24)
                r = ti.Vector([y[0] - self.ring * y[0] / around, y[1] - self.ring * y[1] / around, y[2]])
                length = r.norm(1e-12)
                return r / length, length - self.tube

            def distance(self, points):
                return np.hypot(np.hypot(points[:, 0], points[:, 1]) - self.ring, points[:, 2]) - self.tube

    `mpm.Collider(Torus(0.03, 0.01))` then is a collider like any other. A thin shell is a shape with two sides: see
    `Shell`."""

    radius: float
    """Radius [m] of a ball about the frame's origin that contains the solid."""

    is_thin = False
    """Whether it is a thin shell, with particles on both sides."""
    thickness = 0.0
    """Thickness [m] of a thin shell."""
    thinnest = np.inf
    """Smallest thickness [m] of a solid; infinite where it is not known."""
    passage = np.inf
    """Narrowest gap [m] between its own walls."""
    group: Group | None = None
    """Its fields, which stay as long as the shape does, whatever solvers come and go."""

    def allocate(self) -> None:
        """Copy what kernels look up to fields; `lay_out` calls it, once in a process."""

    def lay_out(self) -> None:
        """Allocate once; outside `backend.allocating`, so that the fields are no solver's."""
        if self.group is None or not self.group.is_present:
            with allocating() as self.group:
                self.allocate()
            weakref.finalize(self, free_later, self.group).atexit = False

    def bake(self, cell: float) -> "Shape":
        """Return the shape as kernels read it on a grid of cells of `cell` [m]; made inside `backend.allocating`."""
        return self

    def signature(self) -> Hashable:
        """Return what two shapes share that kernels cannot tell apart; where one cannot say, the shape itself."""
        return sign(self)

    @ti.func
    def at(self, y):
        """Return the outward unit normal (3,) and the signed distance [m] at y [m] (3,)."""
        return y * 0.0, y[0] * 0.0 + 1.0

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distances [m] (n,) at points [m] (n, 3), on the host."""
        raise NotImplementedError(f"{type(self).__name__} has no distance on the host")

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner [m] (3,) of a box in its frame that contains it."""
        return np.full(3, -self.radius), np.full(3, self.radius)

    def near_inside(self, points: np.ndarray) -> np.ndarray:
        """Return which points (n, 3) [m] can be inside, cheaply: the indices of all within `radius`, or of fewer."""
        return np.flatnonzero(np.einsum("nd,nd->n", points, points) < self.radius**2)

    def nearest_normals(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the normals (n, 3) of a shell's mid-surface closest to points (n, 3), and the distances [m] (n,)."""
        raise NotImplementedError(f"{type(self).__name__} has no mid-surface")

    def least_thickness(self) -> float:
        """Return the smallest thickness [m] of the solid."""
        return self.thinnest

    @ti.func
    def is_beyond(self, y, reach):
        """Conservative early-out: return True only if the surface is farther than reach [m] from y."""
        return False

    @ti.func
    def is_within(self, y, reach):
        """Return whether the surface is nearer to y than reach [m]; everything inside a solid is."""
        near = False
        if not self.is_beyond(y, reach):
            _, phi = self.at(y)
            near = phi < reach
        return near

    @ti.func
    def least_distance(self, y):
        """Return a lower bound [m] of the distance from y to the solid; by default, that from the ball about it."""
        return y.norm() - self.radius

    @ti.func
    def at_back(self, y, normal_bar, phi_bar, real: ti.template()):
        """Return the adjoint of y, of type `real`, from those of normal and distance.
        Central differences in double precision, for shapes without a better way."""
        bar = 0.0 * y
        here = ti.cast(y, ti.f64)
        n, phi = self.at(here)
        for d in ti.static(range(3)):
            step = ti.Vector.unit(3, d, ti.f64) * DIFFERENCE
            n_above, above = self.at(here + step)
            n_below, below = self.at(here - step)
            # at an edge the normal jumps on one side, which is no slope
            up, down = (n_above - n).norm(), (n - n_below).norm()
            used_above, used_below, width = n_above, n_below, 2.0
            if up > KINK * down + KINK * DIFFERENCE:
                used_above, above, width = n, phi, 1.0
            elif down > KINK * up + KINK * DIFFERENCE:
                used_below, below, width = n, phi, 1.0
            slope = ti.cast((used_above - used_below) / (width * DIFFERENCE), real).dot(normal_bar)
            bar[d] = slope + ti.cast((above - below) / (width * DIFFERENCE), real) * phi_bar
        return bar


class ExactShape(Shape):
    """Base of solids whose `at` gives the distance itself, everywhere."""

    @ti.func
    def least_distance(self, y):
        """Return the distance [m] from y to the solid."""
        return self.at(y)[1]

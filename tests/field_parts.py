"""Materials, bodies, places and sheets of which tests of the field make their scenes, and comparisons of states."""

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike

import mpm

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion of a frame that is not turned."""


def at(x: float, y: float, z: float) -> mpm.Pose:
    return mpm.Pose(np.array([x, y, z]), UPRIGHT)


def sand(**numbers: float) -> mpm.DruckerPrager:
    """Soft sand, with other numbers where they are given."""
    return mpm.DruckerPrager(**({"E": 1e5, "nu": 0.2, "density": 1500.0, "friction_angle_deg": 30.0} | numbers))


def block(law: Any, lower: ArrayLike, upper: ArrayLike, spacing: float, velocity: ArrayLike | None = None,
          rng: np.random.Generator | None = None) -> mpm.Body:
    """A body on a lattice in a box [m], with a velocity [m/s] (3,) of all its particles."""
    positions = mpm.sample_box(lower, upper, spacing, rng)
    velocities = None if velocity is None else np.tile(velocity, (len(positions), 1))
    return mpm.Body(law, positions, velocities, volume=spacing**3)


def plate(half: float, axis: int = 2) -> trimesh.Trimesh:
    """A square sheet about the origin, of a half edge [m], across an axis."""
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    return trimesh.Trimesh(np.roll(corners, axis + 1, axis=1), [[0, 1, 2], [0, 2, 3]])


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


def unbalanced(solver: mpm.Solver, advances: int, duration: float, rows: int,
               move: Callable[[int], None] = lambda step: None) -> tuple[float, float]:
    """Advance, each time after `move`; return what the first rows of the ledger lack of the change of momentum, linear
    and angular, over the sum of their magnitudes."""
    before, total, exchanged = np.concatenate(solver.momentum()), np.zeros(6), np.zeros(2)
    for step in range(advances):
        move(step)
        solver.advance(duration)
        total += solver.ledger[:rows].sum(0)
        exchanged += [np.abs(part).sum() for part in np.split(solver.ledger[:rows], 2, axis=1)]
    lacking = np.abs(np.concatenate(solver.momentum()) - before - total).reshape(2, 3).max(1) / exchanged
    return lacking[0], lacking[1]

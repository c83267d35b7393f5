"""Who gave momentum to whom in one coupled step."""

from typing import NamedTuple

import numpy as np

import mpm
from mpm.observers.diagnostics import Momentum
from mpm.state.ledger import FIRST_COLLIDER_ROW, GRAVITY_ROW, WALL_ROW


class Impulse(NamedTuple):
    """Linear [N s] (3,) and angular [N m s] (3,) impulse, the latter about the world's origin."""

    linear: np.ndarray
    angular: np.ndarray


class Ledger(NamedTuple):
    """Who gave momentum to the grains in one step; `residual` is what nobody accounts for."""

    grains: Impulse
    """Change of the grains' momentum."""
    gravity: Impulse
    walls: Impulse
    bodies: dict[str, Impulse]
    """Given by each coupled body; the body received the opposite."""
    static: Impulse
    """Given by colliders that no coupled body carries: containers."""
    residual: Impulse

    @property
    def exchanged(self) -> np.ndarray:
        """Sizes of all impulses that the grains received, summed (2,): linear, angular. What `residual` is small to."""
        parts = [self.gravity, self.walls, self.static, *self.bodies.values()]
        return np.array([sum(np.linalg.norm(p.linear) for p in parts), sum(np.linalg.norm(p.angular) for p in parts)])


def _impulse(row: np.ndarray) -> Impulse:
    return Impulse(row[:3].copy(), row[3:].copy())


def close_ledger(solver: mpm.Solver, before: Momentum, bodies: dict[str, int]) -> Ledger:
    """The ledger of the solver's last advance; before: momentum at its start; bodies: name -> collider."""
    grains = np.concatenate(solver.momentum_after_advance()) - np.concatenate(before)
    rows = solver.ledger
    given = {name: rows[FIRST_COLLIDER_ROW + collider] for name, collider in bodies.items()}
    others = [i for i in range(len(solver.colliders)) if i not in bodies.values()]
    rest = sum((rows[FIRST_COLLIDER_ROW + i] for i in others), np.zeros(6))
    residual = grains - rows[GRAVITY_ROW] - rows[WALL_ROW] - rest - sum(given.values(), np.zeros(6))
    return Ledger(_impulse(grains), _impulse(rows[GRAVITY_ROW]), _impulse(rows[WALL_ROW]),
                  {name: _impulse(row) for name, row in given.items()}, _impulse(rest), _impulse(residual))


def empty_ledger(bodies: dict[str, int]) -> Ledger:
    """The ledger of a step in which nothing happened."""
    zero = Impulse(np.zeros(3), np.zeros(3))
    return Ledger(zero, zero, zero, dict.fromkeys(bodies, zero), zero, zero)

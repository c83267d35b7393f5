"""The momentum balance of one coupled step."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

import mpm
from mpm.observers.diagnostics import Momentum
from mpm.state.ledger import FIRST_COLLIDER_ROW, GRAVITY_ROW, WALL_ROW


class Impulse(NamedTuple):
    """Linear [N s] (3,) and angular [N m s] (3,) impulse in world axes, about the world's origin."""

    linear: np.ndarray
    angular: np.ndarray


class Ledger(NamedTuple):
    """Impulses on the grains in one step, by their source."""

    grains: Impulse
    """Change of the grains' momentum."""
    gravity: Impulse
    """Of gravity."""
    walls: Impulse
    """Of the grid's walls."""
    bodies: dict[str, Impulse]
    """Of each coupled body on the grains; the body received the opposite."""
    static: Impulse
    """Of colliders without a coupled body: containers."""
    sleepers: Impulse
    """Of sleeping grains on those awake, less the momentum that they take up."""
    residual: Impulse
    """Change of momentum that no source accounts for."""

    @property
    def exchanged(self) -> np.ndarray:
        """Sum of the magnitudes of all impulses (2,), linear and angular: the scale of `residual`."""
        rows = np.array([self.gravity, self.walls, self.static, self.sleepers, *self.bodies.values()])
        return np.sqrt((rows * rows).sum(2)).sum(0)


def _impulse(row: np.ndarray) -> Impulse:
    return Impulse(row[:3].copy(), row[3:].copy())


def close_ledger(solver: mpm.Solver, before: Momentum, bodies: dict[str, int]) -> Ledger:
    """Balance the solver's last advance; before: the grains' momentum then; bodies: name -> collider's index."""
    grains = np.concatenate(solver.momentum_after_advance()) - np.concatenate(before)
    rows = solver.ledger
    on_grains = {name: rows[FIRST_COLLIDER_ROW + collider] for name, collider in bodies.items()}
    others = [i for i in range(len(solver.colliders)) if i not in bodies.values()]
    rest = sum((rows[FIRST_COLLIDER_ROW + i] for i in others), np.zeros(6))
    sleepers = np.concatenate(solver.readings.sleepers_impulse)
    residual = grains - rows[GRAVITY_ROW] - rows[WALL_ROW] - rest - sleepers - sum(on_grains.values(), np.zeros(6))
    return Ledger(_impulse(grains), _impulse(rows[GRAVITY_ROW]), _impulse(rows[WALL_ROW]),
                  {name: _impulse(row) for name, row in on_grains.items()}, _impulse(rest), _impulse(sleepers),
                  _impulse(residual))


def ledger_to_rows(ledger: Ledger) -> np.ndarray:
    """Return a ledger as rows (6 + bodies, 6), for `ledger_from_rows`."""
    return np.array([np.concatenate(part) for part in (*ledger[:3], *ledger[4:], *ledger.bodies.values())])


def ledger_from_rows(rows: np.ndarray, bodies: Iterable[str]) -> Ledger:
    """Return the ledger of these rows; bodies: their names, in its order."""
    grains, gravity, walls, static, sleepers, residual, *rest = (_impulse(row) for row in rows)
    return Ledger(grains, gravity, walls, dict(zip(bodies, rest, strict=True)), static, sleepers, residual)


def empty_ledger(bodies: dict[str, int]) -> Ledger:
    """Return the ledger of a step without any impulse."""
    zero = Impulse(np.zeros(3), np.zeros(3))
    return Ledger(zero, zero, zero, dict.fromkeys(bodies, zero), zero, zero, zero)

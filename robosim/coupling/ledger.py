"""The momentum balance of one coupled step."""

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
        """Sum of the magnitudes of all impulses (..., 2), linear and angular: the scale of `residual`."""
        rows = np.array([self.gravity, self.walls, self.static, self.sleepers, *self.bodies.values()])
        return np.moveaxis(np.sqrt((rows * rows).sum(-1)).sum(0), 0, -1)


def write_sums(solver: mpm.Solver, before: Momentum, out: np.ndarray) -> None:
    """Write what the solver's last advance summed to out (rows, 6), linear and angular, about the world's origin.
    Change of the grains' momentum, whose value `before` it is given; gravity, walls, each collider; sleepers."""
    after = solver.momentum_after_advance()
    out[0, :3], out[0, 3:] = after.linear - before.linear, after.angular - before.angular
    out[1:-1] = solver.ledger
    out[-1, :3], out[-1, 3:] = solver.sleepers_impulse


def balance(sums: np.ndarray, bodies: dict[str, int]) -> Ledger:
    """Return the ledger of sums (rows, 6), or of many steps' (..., rows, 6), whose impulses have as many rows then.
    bodies: name -> collider's index."""
    sources = {name: 1 + FIRST_COLLIDER_ROW + collider for name, collider in bodies.items()}
    others = [row for row in range(1 + FIRST_COLLIDER_ROW, sums.shape[-2] - 1) if row not in sources.values()]
    parts = [sums[..., 0, :], sums[..., 1 + GRAVITY_ROW, :], sums[..., 1 + WALL_ROW, :],
             sums[..., others, :].sum(-2), sums[..., -1, :], sums[..., 0, :] - sums[..., 1:, :].sum(-2)]
    grains, gravity, walls, static, sleepers, residual = (Impulse(part[..., :3], part[..., 3:]) for part in parts)
    return Ledger(grains, gravity, walls, {name: Impulse(sums[..., row, :3], sums[..., row, 3:])
                                           for name, row in sources.items()}, static, sleepers, residual)

"""The impulse ledger: rows of (linear [N s], angular [N m s] about the world's origin), summed in double precision."""

from typing import Any, NamedTuple

import numpy as np

from mpm.backend import is_shared, ti
from mpm.scene.walls import WALL_COUNT

STRIPES = 128
"""Copies of a launch's output on a GPU, see `Stripe`; threads of a CPU have one each."""
GRAVITY_ROW, WALL_ROW, FIRST_COLLIDER_ROW = range(3)
"""Ledger rows: gravity with body accelerations, walls, then the colliders; momentum and status follow them."""


class LedgerRows(NamedTuple):
    """Where what a launch sums stands in its output (rows, 6)."""

    first_collider: int
    momentum: int  # linear and angular momentum of all particles
    status: int
    """Sum of squared velocities, largest speed [m/s], substeps until the launch was halted, particles held at walls."""
    walls: int
    """The first of six rows: what each wall adds to `WALL_ROW`, in the order of folding."""
    asleep: int
    """What sleeping particles give to those awake, see `mpm.stepping.sleep_contributions`."""
    count: int  # rows, without those of a counter


def ledger_rows(n_colliders: int) -> LedgerRows:
    """Return the rows of a scene with so many colliders."""
    momentum = FIRST_COLLIDER_ROW + n_colliders
    return LedgerRows(FIRST_COLLIDER_ROW, momentum, momentum + 1, momentum + 2, momentum + 2 + WALL_COUNT,
                      momentum + 3 + WALL_COUNT)


class Stripe(NamedTuple):
    """One of several copies of a launch's output: threads that add to the same number wait for each other."""

    rows: Any  # all copies, one after the other
    first: Any  # first row of this one


def add_stripes(out: np.ndarray, stripes: np.ndarray, status: int) -> None:
    """Add several copies (n rows, 6) of an output to `out` (rows, 6); status: the row that holds the largest speed."""
    every = stripes.reshape(-1, *out.shape)
    out += every.sum(axis=0)
    out[status, 1] = every[:, status, 1].max()


@ti.func
def position(I, origin, cell):
    """Return the position [m] of a node in double precision."""
    return ti.cast(I, ti.f64) * cell + origin


@ti.func
def add(out: ti.template(), row: ti.template(), column: ti.template(), value):
    """Add to an entry of the ledger: a plain load and store with one thread."""
    if ti.static(isinstance(out, Stripe) and is_shared()):
        ti.atomic_add(out.rows[out.first + row, column], value)
    elif ti.static(isinstance(out, Stripe)):
        out.rows[out.first + row, column] = out.rows[out.first + row, column] + value
    elif ti.static(is_shared()):
        ti.atomic_add(out[row, column], value)
    else:
        out[row, column] = out[row, column] + value


@ti.func
def maximise(out: ti.template(), row: ti.template(), column: ti.template(), value):
    """Replace an entry by a value where that is larger."""
    if ti.static(isinstance(out, Stripe) and is_shared()):
        ti.atomic_max(out.rows[out.first + row, column], value)
    elif ti.static(isinstance(out, Stripe)):
        out.rows[out.first + row, column] = ti.max(out.rows[out.first + row, column], value)
    else:
        out[row, column] = ti.max(out[row, column], value)


@ti.func
def credit(out: ti.template(), row: ti.template(), place, impulse):
    """Add an impulse [N s] that acts at a place [m] to a ledger row."""
    p = ti.Vector([ti.cast(impulse[d], ti.f64) for d in range(3)])
    moment = place.cross(p)
    for d in ti.static(range(3)):
        add(out, row, d, p[d])
        add(out, row, 3 + d, moment[d])

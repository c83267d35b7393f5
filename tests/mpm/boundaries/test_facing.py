"""Which material a solid holds with contact="touching"."""

import numpy as np
import pytest
from field_parts import at, block

import mpm
from mpm.scene.scene import Contact

CELL = 0.01


def impulse(contact: Contact, place: float, gap: float, *, static: bool) -> np.ndarray:
    """Return the impulse [N s] (3,) of the first substep on a plate above a bar that rises.
    place: of the bar's end above a plane of nodes, gap: of the plate above it [cells]."""
    end = 0.08 + place * CELL
    bar = block(mpm.Elastic(E=1e3, nu=0.0, density=1000.0), (0.06, 0.06, end - 0.04), (0.12, 0.12, end), CELL / 2,
                (0, 0, 0.1))
    plate = mpm.Collider(mpm.Sdf.box((0.06, 0.06, 0.02)), friction=0.0, static=static,
                         pose=at(0.09, 0.09, end + gap * CELL + 0.02))
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.18, 0.18, 0.16), CELL), bodies=[bar], colliders=[plate],
                    contact=contact, gravity=(0, 0, 0)) as solver:
        if not static:
            solver.set_collider_motion(0, plate.pose, plate.pose)
        solver.advance(solver.dt)
        force = solver.collider_impulse(0).force
    return force


@pytest.mark.parametrize("static", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_end_of_a_bar_is_held_whole(static: bool) -> None:
    """Nodes with little mass, behind the plate's face and beside the bar, are held as the others are.
    Wherever the nodes are: the impulse is then that of "near", which holds all nodes about the end. Before, those
    behind the face were left, and an elastic bar settled up to a quarter too much."""
    for place in (0.0, 0.6):
        held, all_held = (impulse(c, place, 0.0, static=static) for c in ("touching", "near"))
        assert held[2] == pytest.approx(all_held[2], rel=1e-3), place
        assert np.abs(held[:2]).max() < 1e-5 * held[2]


def test_a_plate_away_from_the_bar_is_not_touched() -> None:
    """Its nodes hold mass of the bar, up to a cell and a half away."""
    for place in (0.0, 0.4):
        assert np.all(impulse("touching", place, 0.25, static=False) == 0.0), place
    assert impulse("near", 0.0, 0.25, static=False)[2] > 0.0

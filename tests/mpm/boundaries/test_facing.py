"""Which material a solid holds."""

import numpy as np
import pytest
from field_parts import at, sand

import mpm

CELL, SPEED = 0.01, 0.1


def first_substep(place: float, gap: float, *, static: bool) -> tuple[np.ndarray, float]:
    """Return the impulse [N s] (3,) of the first substep on a plate above a bar that rises, and the momentum [N s] of
    the nodes from half a cell in front of the plate on, by their quadratic B-splines.
    place: of the bar's end above a plane of nodes, gap: of the plate above it [cells]."""
    end = 0.08 + place * CELL
    positions = mpm.sample_box((0.06, 0.06, end - 0.04), (0.12, 0.12, end), CELL / 2)
    bar = mpm.Body(mpm.Elastic(E=1e5, nu=0.0, density=1000.0), positions, np.tile((0, 0, SPEED), (len(positions), 1)),
                   volume=(CELL / 3)**3)  # so small that the plate meets none of them by itself
    plate = mpm.Collider(mpm.Sdf.box((0.06, 0.06, 0.02)), friction=0.0, static=static,
                         pose=at(0.09, 0.09, end + gap * CELL + 0.02))
    nodes = np.arange(np.ceil(end / CELL + gap - 0.51), end / CELL + 2.0)
    distance = np.abs(bar.positions[:, 2:] / CELL - nodes)
    weight = np.where(distance < 0.5, 0.75 - distance**2, np.maximum(1.5 - distance, 0.0)**2 / 2)
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.18, 0.18, 0.16), CELL), bodies=[bar], colliders=[plate],
                    gravity=(0, 0, 0), transfer_interval=0.0) as solver:
        momentum = solver.masses()[0] * SPEED * weight.sum()
        if not static:
            solver.set_collider_motion(0, plate.pose, plate.pose)
        solver.advance(solver.dt)
        force = solver.collider_impulse(0).force
    return force, momentum


@pytest.mark.parametrize("static", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_end_of_a_bar_is_held_whole(static: bool) -> None:
    """Nodes with little mass, behind the plate's face and beside the bar, are held as the others are.
    Wherever the nodes are: before, those behind the face were left, and an elastic bar settled up to a quarter too
    much."""
    for place in (0.0, 0.6):
        held, momentum = first_substep(place, -0.07, static=static)  # the cubes of the last layer touch the plate
        assert held[2] == pytest.approx(momentum, rel=1e-3), place
        assert np.abs(held[:2]).max() < 1e-5 * held[2]


def test_a_plate_away_from_the_bar_is_not_touched() -> None:
    """Its nodes hold mass of the bar, up to a cell and a half away."""
    for place in (0.0, 0.4):
        assert np.all(first_substep(place, 0.25, static=False)[0] == 0.0), place


@pytest.mark.long
def test_a_tool_above_grains_at_rest_on_another_solid_feels_nothing() -> None:
    """Nodes of a thin layer that touches its floor reach the tool, a third of a cell above it."""
    top, layer, gap, level = 0.04, CELL, 0.3 * CELL, [1.0, 0.0, 0.0, 0.0]
    floor, tool = (mpm.Collider(mpm.Sdf.box(half), friction=0.5, static=static, pose=mpm.Pose(np.array(place), level))
                   for half, place, static in (((0.1, 0.1, 0.02), (0.06, 0.06, top - 0.02), True),
                                               ((0.03, 0.03, 0.01), (0.06, 0.06, top + layer + gap + 0.01), False)))
    x = mpm.sample_box((0.01, 0.01, top), (0.11, 0.11, top + layer), CELL / 2)
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.12, 0.12, 0.1), CELL), colliders=[floor, tool],
                    bodies=[mpm.Body(sand(), x, volume=(CELL / 2) ** 3)]) as solver:
        for _ in range(10):
            solver.set_collider_motion(1, tool.pose, tool.pose)
            solver.advance(2e-3)
            assert np.all(solver.collider_impulse(1).force == 0.0)
        assert solver.collider_impulse(0).force[2] < 0.0

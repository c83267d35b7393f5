"""Walls act on what lies at them, and on nothing else."""

import numpy as np
import pytest
from field_parts import block, sand

import mpm
from mpm.state.particle_motion import BACKSTOP

CELL = 0.006


@pytest.mark.parametrize(("interval", "speeds"), [(0.0, (0.1, 0.25, 0.45)), (None, (0.1, 0.25, 0.35))])
def test_sand_that_is_thrown_up_lands_at_its_height(interval: float | None, speeds: tuple[float, ...]) -> None:
    """A block between smooth walls. Walls that stop what their nodes reach held it in the air, by up to a third. Thrown
    harder, in strides, it stays 1 to 3 % too high, by where its grains were."""
    body = block(sand(), (0, 0, 0), (0.048, 0.048, 0.03), CELL / 2, rng=np.random.default_rng(0))
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.048, 0.048, 0.09), CELL), walls=mpm.Walls.all("slip"), bodies=[body],
                    transfer_interval=interval, precision="f32") as solver:
        solver.advance(0.3)
        settled, height = solver.state(), solver.positions()[:, 2].mean()
        for speed in speeds:
            solver.load(settled | {"v": settled["v"] + [0.0, 0.0, speed]})
            solver.advance(0.6)
            assert solver.positions()[:, 2].mean() == pytest.approx(height, rel=0.02), speed


def test_a_grain_that_its_column_hides_stops_before_the_wall() -> None:
    """Below a block at rest: by the masses of its nodes the material is a cell away. The wall takes its momentum."""
    rest = block(sand(), (0.018, 0.018, 0.009), (0.03, 0.03, 0.03), CELL / 2, (0.0, 0.0, 0.0))
    grain = mpm.Body(sand(), [[0.024, 0.024, 0.25 * CELL]], [[0.0, 0.0, -4.0]], volume=(CELL / 2) ** 3)
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.048, 0.048, 0.048), CELL), bodies=[rest, grain], gravity=(0, 0, 0),
                    transfer_interval=0.0) as solver:
        before = np.concatenate(solver.momentum())
        solver.advance(solver.dt)
        assert solver.positions()[-1, 2] == pytest.approx(BACKSTOP * CELL, rel=1e-4)
        assert solver.ledger[1] == pytest.approx(np.concatenate(solver.momentum()) - before, rel=1e-5, abs=1e-12)
        assert solver.ledger[1, 2] > 0 and solver.wall_impulse("z-").force == pytest.approx(-solver.ledger[1, :3])

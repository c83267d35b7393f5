"""Friction of colliders as a number that changes at run time."""

import numpy as np
import pytest
from field_parts import at, block

import mpm


def test_a_friction_that_is_set_is_that_of_one_built_in() -> None:
    ends = []
    for built, later in ((0.1, 0.6), (0.6, None)):
        floor = mpm.Collider(mpm.Sdf.box((0.08, 0.08, 0.02)), friction=built, pose=at(0.08, 0.08, 0.02))
        slider = block(mpm.Elastic(E=1e5, nu=0.2, density=1000.0), (0.04,) * 3, (0.08, 0.08, 0.06), 0.005, (0.3, 0, 0))
        with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.16,) * 3, 0.01), colliders=[floor], bodies=[slider]) as solver:
            if later is not None:
                slippery = solver.state()
                solver.advance(0.05)
                ends.append(solver.positions())
                solver.load(slippery)
                solver.set_friction(0, later)
                assert solver.colliders[0].friction == later
            solver.advance(0.05)
            ends.append(solver.positions())
            with pytest.raises(mpm.InvalidValue, match="friction = -1"):
                solver.set_friction(0, -1.0)
            with pytest.raises(mpm.InvalidValue, match="collider 4"):
                solver.set_friction(4, 0.1)
    assert np.array_equal(ends[1], ends[2]) and ends[0][:, 0].mean() > ends[1][:, 0].mean() + 1e-3

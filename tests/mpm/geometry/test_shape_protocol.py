"""The protocol of a shape: its example is a collider like any other."""

import numpy as np
import pytest
from docstring_example import run_example
from field_parts import at, block, sand

import mpm
from mpm.backend import ti
from mpm.geometry.shape import Shape


def test_the_example_of_a_shape_carries_what_lies_on_it() -> None:
    """A ball of sand that falls on a torus pushes it down by what it loses; kernel and host agree on the distance."""
    Torus = run_example(Shape, "A torus takes ten lines:", {"Shape": Shape, "ti": ti, "np": np})["Torus"]
    torus = Torus(0.03, 0.01)
    points = np.array([[0.03, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.05, 0.0], [0.03, 0.0, 0.02]])
    assert torus.distance(points) == pytest.approx([-0.01, 0.02, 0.01, 0.01])
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.16, 0.16, 0.16), 0.01), precision="f64",
                        bodies=[block(sand(), (0.04, 0.04, 0.07), (0.12, 0.12, 0.1), 0.005, (0, 0, -1.0))],
                        colliders=[mpm.Collider(torus, pose=at(0.08, 0.08, 0.05))])
    before = solver.momentum().linear
    solver.advance(0.02)
    received = solver.collider_impulse(0).force
    given = solver.ledger[:2, 2].sum() + before[2] - solver.momentum().linear[2]
    assert received[2] < -0.05 and received[2] == pytest.approx(given, rel=1e-9)

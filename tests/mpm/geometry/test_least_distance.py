"""Lower bounds of distances: never above the distance, and close to it where a shape knows it."""

import numpy as np
import pytest
import trimesh

import mpm
from mpm.backend import ti
from mpm.geometry.shape import Shape

HALF = (0.02, 0.01, 0.03)
MESH = trimesh.creation.box(np.array(HALF) * 2)
PLACE = mpm.Pose(np.array([0.03, -0.02, 0.01]), np.array([0.8, 0.0, 0.6, 0.0]))
SLACK = 3**0.5 * (1e-3 + 4e-3)
"""Of a lattice [m]: it answers for the least of eight points, a diagonal away, and beyond its box by Pythagoras, which
falls short by at most the distance of the box's corner from the solid: a diagonal of the margin."""
POINTS = np.random.default_rng(0).uniform(-0.15, 0.15, (500, 3))


def bounds(shape: Shape) -> np.ndarray:
    """What a shape says about POINTS (n,) [m]."""
    shape.lay_out()
    found = np.zeros(len(POINTS), np.float32)

    @ti.kernel
    def ask(points: ti.types.ndarray(), out: ti.types.ndarray()):
        for n in range(points.shape[0]):
            out[n] = shape.least_distance(ti.Vector([points[n, 0], points[n, 1], points[n, 2]]))

    ask(POINTS.astype(np.float32), found)
    return found.astype(float)


def distance_to_box(points: np.ndarray) -> np.ndarray:
    """Signed distance [m] of a box, in closed form."""
    away = np.abs(points) - HALF
    return np.linalg.norm(np.maximum(away, 0.0), axis=1) + np.minimum(away.max(1), 0.0)


@pytest.mark.parametrize(("shape", "points", "slack"), [
    (mpm.Sdf.box(HALF), POINTS, 1e-6),
    (mpm.Sdf.from_mesh(MESH, spacing=1e-3), POINTS, SLACK),
    (mpm.Sdf.union([(mpm.Sdf.from_mesh(MESH, spacing=1e-3), PLACE)]), PLACE.inverse().apply(POINTS), SLACK),
    (mpm.Sdf.ellipsoid(HALF), None, None),
], ids=["exact", "lattice", "union", "ball"])
def test_a_bound_is_below_the_distance(shape: Shape, points: np.ndarray | None, slack: float | None) -> None:
    found = bounds(shape)
    if points is None:  # the box around an ellipsoid is closer than it
        assert np.all(found <= np.linalg.norm(POINTS, axis=1) - max(HALF) + 1e-6)
        return
    exact = distance_to_box(points)
    assert np.all(found <= exact + 1e-5) and np.all(found >= exact - slack)

"""Losses against central differences."""

import numpy as np
import pytest

from mpm.geometry.primitives import Box, Sphere
from mpm.geometry.rigid_motion import rotation_matrix
from mpm.rollout.losses import Above, Attraction, Clear, RolloutStates, Sum, Turned, WeightedDistance


@pytest.mark.parametrize("loss", [
    WeightedDistance(np.array([0.1, 0.2, 0.3]), np.array([1.0, 1.0, 2.0]), scale=np.array([1.0, 0.5, 2.0])),
    WeightedDistance(np.array([0.1, 0.2, 0.3]), np.array([1.0, 1.0, 2.0]), chosen=np.array([1, 4, 7]), nearest=2),
    Above(0.5, np.array([1, 2, 5])),
    Attraction(np.array([0.01, 0.02, -0.03]), rest=0.05),
    Clear(np.random.default_rng(2).uniform(size=(20, 3)), Box((0.1, 0.2, 0.3)), 0.5, 0.7),
    Turned(np.eye(3), np.radians(-110.0), step=3, scale=2.0),
    Sum((Attraction(np.zeros(3)), WeightedDistance(np.zeros(3), np.ones(3)))),
])
def test_losses(loss):
    """By positions and by the tool's pose."""
    rng = np.random.default_rng(1)
    x, places = rng.uniform(size=(3, 9, 3)), rng.uniform(size=(3, 3))
    axes, v = rotation_matrix(rng.standard_normal((3, 3))), np.zeros_like(x)
    bars = loss(RolloutStates(np.arange(1, 4), x, v, places, axes))
    for _ in range(20):
        to_x, to_pose = rng.standard_normal(x.shape), rng.standard_normal((3, 6))
        ends = [loss(RolloutStates(np.arange(1, 4), x + s * to_x, v, places + s * to_pose[:, :3],
                          rotation_matrix(s * to_pose[:, 3:]) @ axes)).value for s in (1e-6, -1e-6)]
        slope = (0.0 if bars.x is None else np.sum(bars.x * to_x)) \
            + (0.0 if bars.pose is None else np.sum(bars.pose * to_pose))
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6, abs=1e-8)


def test_a_tool_is_kept_off_what_stands_there():
    """A ball of 0.1 m whose centre is 0.25 m from a point costs nothing at a margin of 0.1; 0.15 m from it, 0.05."""
    loss = Clear(np.array([[0.0, 0.0, 0.0], [0.0, 5.0, 0.0]]), Sphere(0.1), 0.1, 2.0)
    places = np.array([[0.25, 0.0, 0.0], [0.15, 0.0, 0.0]])
    grains = np.zeros((2, 1, 3))
    found = loss(RolloutStates(np.array([1, 2]), grains, grains, places, np.tile(np.eye(3), (2, 1, 1))))
    assert found.value == pytest.approx(0.1) and found.pose is not None
    assert found.pose == pytest.approx(np.array([[0.0] * 6, [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0]]), abs=1e-6)

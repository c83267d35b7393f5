"""Grains that a camera sees past the others are kept, whatever way it looks."""

import numpy as np
import pytest

from robosim.viewer.scene_view import Sight, find_in_sight

RADIUS = 0.004
SPACING = RADIUS / 0.62


def make_sight(eye: np.ndarray, target: np.ndarray) -> Sight:
    """Return a camera that looks from a place to another [m]."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Sight(eye, np.column_stack([right, np.cross(ahead, right), ahead]), 0.5, 0.8)


def make_bed() -> np.ndarray:
    """Return a bed of grains at the usual spacing, a little in disorder (n, 3) [m]."""
    axes = [np.arange(-0.1, 0.1, SPACING), np.arange(-0.1, 0.1, SPACING), np.arange(0.0, 0.06, SPACING)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return grid + np.random.default_rng(0).uniform(-0.2, 0.2, grid.shape) * SPACING


@pytest.mark.parametrize("eye", [(0.6, 0.1, 0.5), (0.0, 0.02, 0.9), (-0.7, -0.4, 0.03), (0.3, 0.3, 0.9)])
def test_no_grain_is_missed_that_nothing_hides(eye: tuple[float, float, float]) -> None:
    """Reference: a grain whose line of sight passes every other one at two radii or more is seen."""
    bed, sight = make_bed(), make_sight(np.array(eye), np.array([0.0, 0.0, 0.03]))
    seen = find_in_sight(bed, sight, RADIUS)
    to_eye = sight.eye - bed
    distance = np.linalg.norm(to_eye, axis=1, keepdims=True)
    direction = to_eye / distance
    for k in np.random.default_rng(1).choice(len(bed), 300, replace=False):
        offset = bed - bed[k]
        along = offset @ direction[k]
        apart = np.linalg.norm(offset - along[:, None] * direction[k], axis=1)
        if not ((along > 0.1 * RADIUS) & (apart < 2.0 * RADIUS)).any():
            assert seen[k]
    assert 0.02 < seen.mean() < 0.6


def test_what_is_behind_the_camera_or_beside_the_picture_is_left_out() -> None:
    sight = make_sight(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    places = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 0.3]])
    assert find_in_sight(places, sight, RADIUS).tolist() == [True, False, False, True]
    assert not find_in_sight(places[1:2], sight, RADIUS).any()


def test_a_camera_that_turned_or_moved_sees_others() -> None:
    sight = make_sight(np.array([1.0, 0.0, 0.5]), np.zeros(3))
    assert sight.has_moved(None, 1.0) and not sight.has_moved(sight, 1.0)
    assert not make_sight(np.array([1.0, 0.005, 0.5]), np.array([0.0, 0.005, 0.0])).has_moved(sight, 1.0)
    assert sight._replace(half_width=2.0 * sight.half_width).has_moved(sight, 1.0)
    assert make_sight(np.array([1.0, 0.1, 0.5]), np.array([0.0, 0.1, 0.0])).has_moved(sight, 1.0)
    assert make_sight(np.array([1.0, 0.0, 0.5]), np.array([0.0, 0.1, 0.0])).has_moved(sight, 1.0)

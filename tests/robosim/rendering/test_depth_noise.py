"""Errors of depth cameras: their size over distance, their steps, and the shadow beside a nearer surface."""

import numpy as np
import pytest

from robosim.base.errors import UnknownName
from robosim.rendering.depth_camera import NOISE, find_noise


@pytest.mark.parametrize("name", NOISE)
@pytest.mark.parametrize("distance", [0.6, 1.0, 2.0])
def test_noise_of_a_plane_has_the_published_size(name: str, distance: float):
    model = NOISE[name]
    measured = model.apply(np.full((200, 200), distance), 600.0, np.random.default_rng(0))
    sigma = model.constant + model.growth * (distance - model.best) ** 2
    step = distance**2 / (model.focal * model.baseline) * model.subpixel
    assert measured.std() == pytest.approx(np.hypot(sigma, step / 12**0.5), rel=0.1)
    assert measured.mean() == pytest.approx(distance, abs=0.1 * sigma)
    disparity = model.focal * model.baseline / measured / model.subpixel
    np.testing.assert_allclose(disparity, np.round(disparity), atol=1e-6)


def test_shadow_is_as_wide_as_the_difference_of_disparities():
    model, focal = NOISE["stereo"], 400.0
    depth = np.full((4, 200), 1.0)
    depth[:, 80:120] = 0.5
    shadow = model.shadows(depth, focal)
    width = focal * model.baseline * (1.0 / 0.5 - 1.0 / 1.0)
    assert shadow[0].sum() == pytest.approx(width, abs=1.0)
    assert shadow[:, 81 - round(width) : 80].all() and not shadow[:, 80:].any()
    assert (model.apply(depth, focal, np.random.default_rng(0))[shadow] == 0.0).all()


def test_nothing_is_measured_too_near_or_where_nothing_is():
    depth = np.array([[0.05, np.inf, 1.0]])
    measured = NOISE["stereo"].apply(depth, 100.0, np.random.default_rng(0))
    assert measured[0, 0] == measured[0, 1] == 0.0 and measured[0, 2] > 0.9


def test_unknown_camera_is_refused():
    with pytest.raises(UnknownName, match="stereo, structured_light"):
        find_noise("lidar")
    assert find_noise(None) is find_noise("none") is None

"""The region of a container that is shown is the one that counts."""

import numpy as np
import pytest

from robosim.base.resources import container_names
from robosim.config.scene import ContainerConfig
from robosim.scene.grains import container_region, is_in_container
from robosim.scene.models import read_inner_size


@pytest.mark.parametrize("name", container_names())
def test_it_holds_the_grains_that_count_however_the_container_is_turned(name: str) -> None:
    container, size = ContainerConfig(position=(0.7, -0.2, 0.006), yaw_deg=35.0), np.array(read_inner_size(name))
    region, pose = container_region(name, container)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20_000, 3)) * size + [0.7, -0.2, size[2] / 2]
    counted = is_in_container(points, name, container)
    assert 1000 < counted.sum() < 19_000
    assert np.array_equal(region.holds(pose.inverse().apply(points)), counted)

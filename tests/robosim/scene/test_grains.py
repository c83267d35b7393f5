"""Initial positions of the grains, and the checks of what can be filled."""

import numpy as np
import pytest

import mpm
from robosim.config.rehearsal import load_rehearsal
from robosim.errors import ConfigError
from robosim.scene.field import build_tool_sdf, check_field
from robosim.scene.grains import fill
from robosim.shapes import tool_shape


def test_material_fills_the_configured_region():
    """In the bottle up to the fill height and not in its wall; on the table as large as the pile."""
    bottle, rng = load_rehearsal("bottle"), np.random.default_rng(0)
    sdf = build_tool_sdf("bottle", bottle.collision_thickness)
    pose = mpm.Pose(np.array([0.7, 0.1, 0.3]), np.array([1.0, 0.0, 0.0, 0.0]))
    positions, volume = fill(bottle, sdf, pose, rng)
    local, region = positions - pose.position, tool_shape("bottle").interior
    assert region.holds(local).all() and (sdf.distance(local) > 0).all()
    height = local[:, 2].max() - (region.centre[2] - region.half[2])
    assert height == pytest.approx(bottle.tool_fill_height, abs=0.005)
    # a body of 3 cm radius, filled to about 5 cm above its floor
    assert volume * len(positions) == pytest.approx(np.pi * 0.03**2 * 0.052, rel=0.15)
    shovel = load_rehearsal("shovel")
    positions, volume = fill(shovel, sdf, pose, rng)
    assert volume * len(positions) == pytest.approx(0.05 * 0.05 * 0.015, rel=1e-9)
    assert (np.abs(positions - shovel.pile.centre) <= np.array(shovel.pile.half) + 1e-12).all()
    with pytest.raises(ConfigError, match="tool_fill_height = 0.2 m; accepted: up to"):
        check_field(load_rehearsal("bottle", {"tool_fill_height": 0.2}), mpm.Elastic(E=1e5, nu=0.2, density=1000.0))

"""Where the material counts as delivered, retained or spilled."""

from types import SimpleNamespace

import numpy as np
import pytest

import mpm
from robosim.config.rehearsal import load_rehearsal
from robosim.rehearsal.mass_balance import compute_fractions
from robosim.scene.grains import is_in_tool
from robosim.shapes import tool_shape


def test_grains_in_the_tool_are_not_delivered():
    """Grains above the area count after they left the bottle; those in front of a shovel's blade count at once."""
    for name, expected in (("bottle", (1.0 / 3.0, 1.0 / 3.0)), ("shovel", (2.0 / 3.0, 0.0))):
        config = load_rehearsal(name)
        middle = np.array(tool_shape(name).interior.centre)
        pose = mpm.Pose(np.array(config.area.centre) - middle, np.array([1.0, 0.0, 0.0, 0.0]))
        on_the_area = np.array(config.area.centre) + [0.0, 0.045, 0.0]
        run = SimpleNamespace(config=config, scooped=np.ones(3, bool),
                              is_held=lambda places, name=name, pose=pose: is_in_tool(name, places, pose),
                              solver=SimpleNamespace(masses=lambda: np.ones(3)))
        fractions = compute_fractions(run, np.array([config.area.centre, on_the_area, [0.0, 0.0, 0.0]]))
        assert (fractions["delivered_fraction"], fractions["retained_fraction"]) == pytest.approx(expected)
        assert fractions["spilled_fraction"] == pytest.approx(1.0 / 3.0)

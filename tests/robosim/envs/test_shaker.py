"""The shaker: what leaves its holes is the law's and arrives in the cup; what it cannot be used with is refused."""

import numpy as np
import pytest
from grain_envs import make, play

from robosim.base.errors import ConfigError
from robosim.scene.field import build_tool_sdf
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.task import load_task


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_script_shakes_salt_into_the_cup() -> None:
    """Upright it keeps all of it; turned over, what has left the holes is in the cup or falls there."""
    env = make("DoseShaker", task=load_task("DoseShaker").model_copy(update={"steps": 2000}), randomize={})
    _, info, _ = play(env)  # 4 s
    readings, passed = info["readings"], float(env.solver.passed_mass(TOOL).sum())
    grain = env.solver.masses()[0]
    assert passed > 20 * grain and readings["spilled"] == 0.0
    held = readings["held"] + readings["poured"] + readings["elsewhere"]
    assert held == pytest.approx(1000 * grain, rel=1e-6)
    assert readings["poured"] <= passed * (1 + 1e-6) and readings["poured"] > passed - 30 * grain
    # at most the law's rate times the time after it was turned over
    law = env.solver.colliders[TOOL].orifices[0]
    assert passed < 13 * law.rate(env.solver.bodies[0].material.density) * 4.0
    env.close()


def test_holes_lie_in_the_cap() -> None:
    shape = tool_shape("shaker")
    (orifice,) = shape.orifices(3.5e-4)
    assert orifice.positions.shape == (13, 3) and orifice.ratio == pytest.approx(2.5e-3 / 3.5e-4)
    apart = np.linalg.norm(orifice.positions[:, None] - orifice.positions, axis=2) + np.eye(13)
    assert apart.min() > 1.5 * orifice.diameter
    assert tool_shape("bottle").orifices(3.5e-4) == []


def test_what_a_shaker_cannot_be_used_with_is_refused() -> None:
    with pytest.raises(ConfigError, match="'shaker' with a material without grain_diameter"):
        make("DoseShaker", material="flour")
    with pytest.raises(ConfigError, match="randomize: material with the tool 'shaker'"):
        make("DoseShaker", randomize={"material": ["salt", "sugar"]})
    with pytest.raises(ConfigError, match="'shaker' with a wall of 0.003 m: its holes are smaller than a cell"):
        build_tool_sdf("shaker", 0.003)

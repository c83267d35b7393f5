"""Sub-tasks in sequence: each begins with the grains that the one before left in the tool."""

import json

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import robosim
from robosim.base.errors import ConfigError
from robosim.studies.evaluation.motion_chain import run_chain
from robosim.tasks import handover
from robosim.tasks.counting import TOOL
from robosim.tasks.task import load_task


def test_strains_rotate_with_the_tool():
    """A strain along x, rotated by 90 deg about z, is one along y; rotating back restores it."""
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    assert handover.rotate_strain(np.array([[0.1, 0, 0, 0.02, 0, 0]]), quarter) == pytest.approx(
        np.array([[0, 0.1, 0, -0.02, 0, 0]]))
    e, R = np.random.default_rng(0).normal(size=(5, 6)), Rotation.random(rng=1).as_matrix()
    assert handover.rotate_strain(handover.rotate_strain(e, R), R.T) == pytest.approx(e)
    before, after = e[:, handover.MATRIX_FROM_SIX], handover.rotate_strain(e, R)[:, handover.MATRIX_FROM_SIX]
    assert np.linalg.eigvalsh(after) == pytest.approx(np.linalg.eigvalsh(before))


@pytest.mark.long
def test_the_next_sub_task_begins_with_the_grains_that_are_left():
    """The same grains at the same positions in the tool under the same stress, and they stay at rest.
    A sub-task with another tool, or one that begins with an empty tool, is refused."""
    first = gymnasium.make("robosim/SpoonTranslate-v0", material="sugar").unwrapped
    first.reset(seed=3)
    still = np.zeros(3, np.float32)
    for _ in range(3):
        first.step(still)
    state = first.solver.state()
    state["x"][:50, 2] += 0.15  # these have left the spoon
    first.solver.load(state)
    load = handover.take_load(first)
    assert load.count == first.task.grains.count - 50 and load.material == first.material
    second = gymnasium.make("robosim/SpoonPour-v0", load=load).unwrapped
    second.reset(options={"nominal": True})
    local = second.solver.collider_pose(TOOL).inverse().apply(second.solver.positions())
    assert local == pytest.approx(load.positions, abs=1e-6)
    assert second.material == first.material and second.task.grains.count == load.count
    assert second.solver.masses().sum() == pytest.approx(first.solver.masses()[50:].sum())
    R = second.task.start.pose.matrix @ first.solver.collider_pose(TOOL).matrix.T
    strains = handover.rotate_strain(first.solver.state()["e"][50:], R)
    assert second.solver.state()["e"] == pytest.approx(strains, abs=1e-6) and np.abs(strains).max() > 1e-5
    for _ in range(3):
        _, _, _, _, info = second.step(np.zeros(6, np.float32))
    assert info["readings"]["retained"] == 1.0 and np.linalg.norm(second.solver.velocities(), axis=1).max() < 0.1
    for task in ("ScoopPour", "SpoonScoop"):
        with pytest.raises(ConfigError, match="accepted: a sub-task that begins with a full spoon, as SpoonTranslate"):
            handover.task_with_load(task, load_task(task), load)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spoon", "scoop"])
def test_the_bundled_chains_deliver(name, tmp_path, capsys):
    """At least nine tenths of what was scooped, as on the whole arm."""
    assert robosim and run_chain(name, tmp_path, film=False) == 0
    rows = json.loads((tmp_path / "chain.json").read_text())["sub_tasks"]
    scooped, last = rows[0]["from_settled_start"]["grains_in_tool"], rows[-1]["from_previous"]
    assert last["delivered"] * last["grains"] >= 0.9 * scooped > 90
    assert rows[0]["from_settled_start"]["rotation_relative_error"] < {"spoon": 0.001, "scoop": 0.02}[name]
    assert "what was left" in capsys.readouterr().out

"""Files of recorded motions, and the rehearsals that they fit."""

import numpy as np
import pytest

from robosim.base.errors import ConfigError
from robosim.config.rehearsal import load_rehearsal
from robosim.planning import recorded_motions
from robosim.planning.recorded_motions import SAMPLING, find_motion, load_motion, place_target
from robosim.planning.recorded_path import RecordedPath
from robosim.tasks.task import load_task


def test_motions_that_do_not_fit_are_refused(monkeypatch, write_motions):
    monkeypatch.setattr(recorded_motions, "trained", lambda name: None)
    with pytest.raises(ConfigError, match="no bundled motion for BottlePickPour"):
        place_target(load_rehearsal("bottle", {"trajectory": "recorded"}))
    with pytest.raises(ConfigError, match="moves a shovel; the rehearsal's tool is bottle"):
        place_target(load_rehearsal("bottle", {"trajectory": "recorded", "recorded": ["ShovelMove"]}))
    folder = write_motions("ScoopScoop")
    monkeypatch.setattr(recorded_motions, "trained", lambda name: folder / f"{name}.npz")
    config = load_rehearsal("scoop", {"trajectory": "recorded", "recorded": ["ScoopScoop"]})
    rotated = config.model_copy(update={"containers": {
        name: box.model_copy(update={"yaw_deg": 0.0}) for name, box in config.containers.items()}})
    with pytest.raises(ConfigError, match="yaw_deg 90"):
        place_target(rotated)


def test_a_motion_needs_the_start_it_was_recorded_from():
    """A full tool, a pile or a filled container; the target area moves with the motion."""
    with pytest.raises(ConfigError, match="begins with a full spoon"):
        place_target(load_rehearsal("spoon", {"trajectory": "recorded", "recorded": ["SpoonTranslate"]}))
    shovel = load_rehearsal("shovel", {"trajectory": "recorded",
                                       "pile": {"centre": [0.70, -0.08, 0.0075], "half": [0.02, 0.02, 0.0075]}})
    task, placed = load_task("ShovelMove"), place_target(shovel)
    assert placed.area.centre[:2] == pytest.approx(np.array(task.target.centre[:2]) + [-0.08, 0.02])
    path = RecordedPath(placed)
    begin = path.pose(0.0).position - task.start.position
    assert begin == pytest.approx([-0.08, 0.02, 0.0], abs=1e-9)
    assert place_target(load_rehearsal("shovel")) == load_rehearsal("shovel")


def test_a_pour_ends_after_the_actions_that_it_needs(write_motions):
    """A transport is complete: its tool is level at the end."""
    for name, seconds in (("SpoonPour", 0.6), ("SpoonTranslate", 2.0)):
        folder = write_motions(name)
        with np.load(folder / f"{name}.npz") as stored:
            np.savez(folder / f"{name}.npz", **stored, needed=30)
        motion = load_motion(folder / f"{name}.npz", name, load_task(name))
        assert len(motion.positions) - 1 == round(seconds / SAMPLING)
        assert motion.positions[-1, 1] - motion.positions[0, 1] == pytest.approx(0.02 * seconds, abs=1e-9)
    np.savez(folder / "SpoonPour.npz", actions=np.zeros((100, 3)), action_repeat=10)
    with pytest.raises(ConfigError, match=r"SpoonPour.npz: not a motion of SpoonPour: .*shape \(3,\)"):
        load_motion(folder / "SpoonPour.npz", "SpoonPour", load_task("SpoonPour"))


def test_motions_are_those_of_the_users_folder(tmp_path):
    config = load_rehearsal("spoon", {"trajectory": "recorded", "motions": str(tmp_path)})
    with pytest.raises(ConfigError, match=r"holds no SpoonScoop.npz; accepted: a folder with a motion of each"):
        find_motion(config, "SpoonScoop")
    (tmp_path / "SpoonScoop.npz").touch()
    assert find_motion(config, "SpoonScoop") == tmp_path / "SpoonScoop.npz"
    assert find_motion(load_rehearsal("spoon"), "SpoonScoop").parent.name == "trained"

"""Planning of the rehearsals: all scripts are feasible, and invalid configurations are refused."""

import pytest
from bundled import plan_of

from robosim.base.errors import ConfigError
from robosim.config.materials import load_material
from robosim.config.rehearsal import load_rehearsal
from robosim.scene.field import check_field


@pytest.mark.parametrize("name", ["spoon", "scoop", "bottle", "pick_bottle", "shovel", "dose_spoon", "dose_bottle"])
def test_every_script_can_be_planned(name):
    """Within the arm's limits and joint ranges; the field accepts every bundled granular material."""
    assert plan_of(name).solution.margin > 0.01
    for material in ("salt", "sugar", "flour", "sand", "paper"):
        check_field(load_rehearsal(name), load_material(material).make_law())


@pytest.mark.parametrize("name, changes, message", [
    ("bottle", {"pile": {"centre": [0.7, 0, 0.01], "half": [0.01] * 3}}, "2 kinds of places hold material"),
    ("shovel", {"pile": None}, "0 kinds of places hold material"),
    ("shovel", {"area": None}, "0 kinds of places take material"),
    ("spoon", {"containers": {"bucket": {"position": [0.7, 0, 0]}}}, "unknown 'bucket'; valid: source, target, tray"),
    ("bottle", {"trajectory": "learned", "learned": []}, "needs `learned`"),
    ("bottle", {"weigh_at": "lifted"}, "needs a dwell"),
    ("pick_bottle", {"grasp": "weld"}, "pick with grasp: weld, trajectory: script; accepted: friction, script"),
    ("pick_bottle", {"gripper": "none"}, "pick with gripper: none; accepted: a gripper"),
])
def test_invalid_rehearsals_are_refused(name, changes, message):
    with pytest.raises(ConfigError, match=message):
        load_rehearsal(name, changes)

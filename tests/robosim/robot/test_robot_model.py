"""The models of Pinocchio and MuJoCo describe the same robot."""

import numpy as np
import pytest

from robosim.robot.mjspec import compile_spec
from robosim.robot.model import Arm
from robosim.scene.models import assemble


@pytest.fixture(scope="module")
def pair():
    assembly = assemble("spoon")
    return compile_spec(assembly.build_spec()), Arm(assembly)


def test_no_joint_is_missing_in_either_model(pair) -> None:
    """Their dynamics are compared by the verification case `two_models`."""
    model, arm = pair
    assert sorted(model.joint(j).name for j in range(model.njnt)) == sorted(arm.model.names[1:])
    assert arm.model.nv == model.nv


def test_limits_are_the_data_sheets(pair) -> None:
    """KUKA LBR iiwa 14 R820 data sheet: ranges, speeds and torques, read back from both compiled models."""
    model, arm = pair
    ranges = np.radians([170, 120, 170, 120, 170, 120, 175])
    torques = [320, 320, 176, 176, 110, 40, 40]
    for i, name in enumerate(arm.joints):
        joint = model.joint(name)
        assert joint.range == pytest.approx([-ranges[i], ranges[i]], abs=1e-6)
        assert model.jnt_actfrcrange[joint.id] == pytest.approx([-torques[i], torques[i]])
        assert model.actuator(name).ctrlrange == pytest.approx([-torques[i], torques[i]])
    assert arm.torque_limits == pytest.approx(torques)
    assert arm.model.upperEffortLimit[arm.v_index] == pytest.approx(torques)
    assert np.degrees(arm.velocity) == pytest.approx([85, 85, 100, 75, 130, 135, 135])


def test_smallest_moment_of_the_long_links_is_about_the_long_axis(pair) -> None:
    """Links 2, 4 and 6 have the corrected moments: the published ones have the last two exchanged."""
    model, _ = pair
    assert model.body("link2").inertia == pytest.approx([0.0305, 0.0304, 0.0110])
    assert model.body("link4").inertia == pytest.approx([0.0170, 0.0164, 0.0060])
    assert model.body("link6").inertia == pytest.approx([0.0049, 0.0047, 0.0036])


def test_masses(pair) -> None:
    """Arm 29.9 kg (data sheet), hand 2.3 kg."""
    model, _ = pair
    assert sum(model.body(f"link{i}").mass[0] for i in range(8)) == pytest.approx(29.9, abs=1e-9)
    assert model.body("hand_palm").subtreemass[0] - model.body("spoon").mass[0] == pytest.approx(2.3, abs=1e-9)

"""Pinocchio and MuJoCo must mean the same robot."""

import mujoco
import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

from robosim.arm import SPEED_LIMITS, Arm
from robosim.scene import ARM_JOINTS, compiled, load_spec, robot_spec
from robosim.shapes.handle import grip_pose
from robosim.shapes.spoon import HANDLE_START


@pytest.fixture(scope="module")
def pair():
    model = compiled(robot_spec("spoon"))
    return model, mujoco.MjData(model), Arm("spoon")


def orders(model: mujoco.MjModel, arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Places of MuJoCo's joints in Pinocchio's q and v."""
    names = [model.joint(j).name for j in range(model.njnt)]
    ids = [arm.model.getJointId(name) for name in names]
    return (np.array([arm.model.joints[i].idx_q for i in ids]), np.array([arm.model.joints[i].idx_v for i in ids]))


def test_mass_matrix_bias_and_kinematics_agree(pair) -> None:
    """200 random states of arm, fingers and tool, to 1e-9."""
    model, data, arm = pair
    rng = np.random.default_rng(7)
    q_index, v_index = orders(model, arm)
    assert sorted(v_index) == list(range(model.nv)) and arm.model.nv == model.nv
    worst = np.zeros(3)
    for _ in range(200):
        data.qpos[:] = rng.uniform(model.jnt_range[:, 0], model.jnt_range[:, 1])
        data.qvel[:] = rng.uniform(-1.0, 1.0, model.nv)
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        q, v = np.zeros(arm.model.nq), np.zeros(arm.model.nv)
        q[q_index], v[v_index] = data.qpos, data.qvel
        P = pinocchio.crba(arm.model, arm.data, q)
        P = np.triu(P) + np.triu(P, 1).T
        bias = pinocchio.nonLinearEffects(arm.model, arm.data, q, v)
        pinocchio.forwardKinematics(arm.model, arm.data, q)
        placement = pinocchio.updateFramePlacement(arm.model, arm.data, arm.frame)
        worst = np.maximum(worst, [
            np.abs(P[np.ix_(v_index, v_index)] - M).max(),
            np.abs(bias[v_index] - data.qfrc_bias).max(),
            max(np.abs(placement.translation - data.body("spoon").xpos).max(),
                np.abs(placement.rotation.ravel() - data.body("spoon").xmat).max()),
        ])
    assert worst.max() <= 1e-9, worst


def test_limits_are_the_data_sheets(pair) -> None:
    """KUKA LBR iiwa 14 R820 data sheet: ranges, speeds and torques, read back from both compiled models."""
    model, _, arm = pair
    ranges = np.radians([170, 120, 170, 120, 170, 120, 175])
    torques = [320, 320, 176, 176, 110, 40, 40]
    for i, name in enumerate(ARM_JOINTS):
        joint = model.joint(name)
        assert joint.range == pytest.approx([-ranges[i], ranges[i]], abs=1e-6)
        assert model.jnt_actfrcrange[joint.id] == pytest.approx([-torques[i], torques[i]])
        assert model.actuator(name).ctrlrange == pytest.approx([-torques[i], torques[i]])
    assert arm.torque_limits == pytest.approx(torques)
    assert arm.model.upperEffortLimit[arm.v_index] == pytest.approx(torques)
    assert np.degrees(SPEED_LIMITS) == pytest.approx([85, 85, 100, 75, 130, 135, 135])


def test_smallest_moment_of_the_long_links_is_about_the_long_axis(pair) -> None:
    """Links 2, 4 and 6 carry the corrected moments: the published set has the last two swapped."""
    model, _, _ = pair
    assert model.body("link2").inertia == pytest.approx([0.0305, 0.0304, 0.0110])
    assert model.body("link4").inertia == pytest.approx([0.0170, 0.0164, 0.0060])
    assert model.body("link6").inertia == pytest.approx([0.0049, 0.0047, 0.0036])


def test_masses(pair) -> None:
    """Arm 29.9 kg (data sheet), hand 2.3 kg."""
    model, _, _ = pair
    arm = sum(model.body(f"link{i}").mass[0] for i in range(8))
    hand = model.body("palm").subtreemass[0] - model.body("spoon").mass[0]
    assert arm == pytest.approx(29.9, abs=1e-9)
    assert hand == pytest.approx(2.3, abs=1e-9)


def test_spoon_is_held_where_its_handle_is() -> None:
    """The grip site in the model file lies on the handle's axis, as the shape has it, turned to the hand."""
    spec = load_spec("tools", "spoon", "spoon.xml")
    site, pose = spec.site("spoon_grip"), grip_pose(HANDLE_START)
    assert site.pos == pytest.approx(pose[:3, 3], abs=1e-5)
    matrix = Rotation.from_quat(site.quat, scalar_first=True).as_matrix()
    assert matrix == pytest.approx(pose[:3, :3], abs=1e-6)

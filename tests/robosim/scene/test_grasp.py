"""Grasp by friction: slip under load and in motion; external torque from the joint torque sensors."""

import mujoco
import numpy as np
import pytest
from bundled import rehearsal

from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.dosing.motion import Vibration
from robosim.rehearsal.run import make_cell
from robosim.robot.joint_control import TorqueSensors
from robosim.robot.mjspec import body_pose
from robosim.robot.model import Arm
from robosim.robot.timing import JointState
from robosim.scene.build import assemble_rehearsal, compile_rehearsal
from robosim.scene.compiled import Scene
from robosim.scene.grasp import HOLDER, Grasp
from robosim.shapes import tool_shape

POSTURE = np.array([-0.9, 0.7, 0.45, -1.75, -0.78, -0.83, 1.8])


def hold(config: RehearsalConfig, load: np.ndarray, duration: float, swing: float = 0.0,
         ) -> tuple[Scene, mujoco.MjData, Grasp, np.ndarray]:
    """Close the fingers on the tool with the arm at rest, release it and apply a force [N] (3,) at its centre of mass.

    swing: amplitude [rad] of a joint motion from 0.7 s on, with a period of 2 s. Returns scene, state, grasp, and the
    joint speeds (7,) before the last step.
    """
    cell, before = make_cell(config, Arm(assemble_rehearsal(config)), POSTURE), np.zeros(7)
    scene, data = cell.scene, cell.data
    grasp = Grasp(scene, data)  # of the grip alone
    while data.time < duration:
        phase = np.pi * max(data.time - 0.7, 0.0)
        angles, speeds = POSTURE + 0.5 * swing * (1.0 - np.cos(phase)), 0.5 * np.pi * swing * np.sin(phase)
        cell.command(JointState(angles, speeds, 0.0 * speeds))
        if data.time < 0.5:
            grasp.close(min(data.time / 0.3, 1.0))
        else:
            grasp.release()
            data.xfrc_applied[scene.tool, :3] = load
        before = cell.qd.copy()
        mujoco.mj_step(scene.model, data)
        mujoco.mj_kinematics(scene.model, data)
        grasp.measure_slip()
    return scene, data, grasp, before


@pytest.mark.parametrize("name", ["spoon", "bottle"])
def test_tool_held_by_friction_does_not_creep_while_the_arm_moves(name: str) -> None:
    """All joints swing by 0.3 rad; as a free body the tool would creep by 1 mm in a second, at any time step."""
    config = rehearsal(name, grasp="friction")
    settled = hold(config, np.zeros(3), 0.8)[2].slip
    assert settled < 0.0015
    _, data, grasp, _ = hold(config, np.zeros(3), 3.2, swing=0.3)  # ends in the middle of a swing, at speed
    assert grasp.is_released and np.abs(data.qvel).max() > 0.1
    assert grasp.slip - settled < 0.0003


@pytest.mark.slow
@pytest.mark.parametrize("gripper", ["robotiq_3f", "parallel_jaw"])
def test_a_filled_spoon_is_held_for_two_minutes_and_shaken(gripper: str) -> None:
    """50 g in the bowl, shaken as `dose_spoon` does: the lip stays within 2 mm in the hand, and does not creep on."""
    config = rehearsal("dose_spoon", grasp="friction", gripper=gripper)
    arm = Arm(assemble_rehearsal(config))
    cell = make_cell(config, arm, POSTURE)
    scene, data, grasp = cell.scene, cell.data, cell.grasp
    vibration, level = Vibration("y"), arm.tool_pose(POSTURE)
    q, slips, load = POSTURE, [], np.array([0.0, 0.0, -0.05 * 9.81])
    to_joints, bowl = np.linalg.pinv(arm.jacobian(POSTURE)[:3]) @ level.matrix.T, 0.85 * tool_shape(config.tool).tip
    while data.time < 121.0:
        before = q
        if data.time < 0.8:
            grasp.close(min(data.time / 0.6, 1.0))
        else:
            grasp.release()
            q = POSTURE + to_joints @ (vibration.shake(level, config.host_dt, 0.0005, 30.0).position - level.position)
            arm_of_load = body_pose(data, scene.tool).apply(bowl[None])[0] - data.xipos[scene.tool]
            data.xfrc_applied[scene.tool] = np.concatenate([load, np.cross(arm_of_load, load)])
        cell.command(JointState(q, (q - before) / config.host_dt, np.zeros(7)))
        mujoco.mj_step(scene.model, data)
        mujoco.mj_kinematics(scene.model, data)
        grasp.measure_slip()
        slips.append(grasp.slip)
    assert 1e-5 < slips[-1] < 0.002
    assert slips[-1] - slips[len(slips) // 2] < 0.0005


def test_a_hand_that_has_not_closed_is_refused() -> None:
    """The jaws need 0.6 s for the handle's thickness; the spoon fell by 16 mm into them after 0.5 s."""
    with pytest.raises(ConfigError, match="has not closed on spoon when .*; accepted: a longer grasp_time"):
        hold(rehearsal("spoon", grasp="friction", gripper="parallel_jaw"), np.zeros(3), 0.6)


def test_contact_is_as_stiff_as_the_pads() -> None:
    """3 N rotate a scoop in the fingers by 0.02 deg: contact compliance is that of the pads.

    MuJoCo's mean with the default compliance of the metal handle would give 0.05 deg."""
    config = rehearsal("scoop", grasp="friction")
    angles = []
    for load in (0.0, -3.0):
        scene, data, grasp, _ = hold(config, np.array([0.0, 0.0, load]), 1.5)
        angles.append(np.degrees(grasp.slip_angle))
    assert 0.0 < angles[1] - angles[0] < 0.03
    model, pads = scene.model, ("hand_f1_pad", "hand_f2_pad", "hand_fm_pad")
    contacts = [c for c in data.contact if model.geom(c.geom1).name in pads or model.geom(c.geom2).name in pads]
    assert contacts and all(c.solref == pytest.approx(model.geom("hand_fm_pad").solref) for c in contacts)


def test_a_free_tool_collides_with_the_palm() -> None:
    """Pushed up between the fingers, the handle stops where the palm begins."""
    config = rehearsal("spoon", grasp="friction")
    model = compile_rehearsal(config).model
    assert model.nq == 23  # seven of the arm, nine of the hand, seven of a free tool
    data = mujoco.MjData(model)
    data.eq_active[model.equality(HOLDER).id] = 0
    palm = model.body("hand_palm").id
    first = model.jnt_qposadr[model.body_jntadr[model.body("spoon").id]]
    mujoco.mj_kinematics(model, data)
    R = data.xmat[palm].reshape(3, 3)
    data.qpos[first : first + 3] = body_pose(data, model.body("spoon").id).matrix.T @ R @ [0.0, -0.1, 0.0]
    mujoco.mj_forward(model, data)
    touching = {frozenset((model.geom(c.geom1).name, model.geom(c.geom2).name)) for c in data.contact}
    assert frozenset(("hand_palm_box", "spoon_handle")) in touching


def test_external_torque_is_the_one_of_the_load() -> None:
    """J^T F of a force on the spoon, at rest; near zero without a force."""
    config = rehearsal("spoon")
    arm = Arm(assemble_rehearsal(config))
    external = {}
    for force in (0.0, -6.0):
        scene, data, grasp, before = hold(config, np.array([0.0, 2.0 * (force != 0), force]), 1.5)
        assert not grasp.is_by_friction and grasp.slip == 0.0  # the tool is fixed
        sensors = TorqueSensors(scene.model, data, arm)
        q, qd = data.qpos[scene.arm_qpos], data.qvel[scene.arm_dofs]
        external[force] = sensors.estimate_external(q, before, (qd - before) / scene.model.opt.timestep)
    jacobian = np.empty((3, scene.model.nv))
    mujoco.mj_jacBodyCom(scene.model, data, jacobian, None, scene.tool)
    expected = jacobian[:, scene.arm_dofs].T @ [0.0, 2.0, -6.0]
    assert np.abs(expected).max() > 3.0
    assert external[-6.0] - external[0.0] == pytest.approx(expected, abs=0.01 * np.abs(expected).max())
    assert np.abs(external[0.0]).max() < 0.2  # the model has open fingers, the scene closed ones

"""Errors of the model change the simulated robot, and only where they should."""

import mujoco
import numpy as np

from mpm.geometry.rigid_motion import relative_rotation
from robosim.config.rehearsal import load_rehearsal
from robosim.robot.model import Gains
from robosim.robot.model_errors import FRICTION, GAINS, LATENCY, PAYLOAD, SHIFT, TURN_DEG, ModelErrors
from robosim.robot.model_errors import draw_model_errors as draw
from robosim.scene.build import assemble_rehearsal, build_rehearsal_spec
from robosim.scene.compiled import compile_scene

NONE = ModelErrors(1.0, np.ones(7), 0.0, np.zeros(3), np.zeros(3), 1.0, 1.0)


def test_errors_are_drawn_within_their_ranges_and_by_their_seed() -> None:
    drawn = [draw(seed, 6) for seed in range(200)]
    assert draw(3, 6).figures() == drawn[3].figures() != drawn[4].figures()
    payloads, frictions = np.array([e.payload for e in drawn]), np.array([e.friction for e in drawn])
    assert frictions.shape == (200, 6)
    for values, middle, half in ((payloads, 1.0, PAYLOAD), (frictions, 1.0, FRICTION),
                                 (np.array([e.stiffness for e in drawn]), 1.0, GAINS),
                                 (np.array([e.latency for e in drawn]), np.mean(LATENCY), np.ptp(LATENCY) / 2),
                                 (np.array([e.tool_shift for e in drawn]), 0.0, SHIFT),
                                 (np.array([e.tool_turn_deg for e in drawn]), 0.0, TURN_DEG)):
        reached = np.abs(values - middle).max()
        assert 0.95 * half < reached <= half


def test_no_errors_change_nothing_and_a_payload_changes_hand_and_tool_alone() -> None:
    config = load_rehearsal("spoon")
    assembly = assemble_rehearsal(config)
    exact = compile_scene(build_rehearsal_spec(config, assembly), assembly)
    for errors in (NONE, NONE._replace(payload=1.2, friction=np.linspace(0.5, 1.5, 7), stiffness=0.9, damping=1.1,
                                       tool_shift=np.array([1e-3, 0.0, 0.0]),
                                       tool_turn_deg=np.array([0.0, 0.3, 0.4]))):
        spec = build_rehearsal_spec(config, assembly)
        errors.place_tool(spec, config.tool)
        scene = compile_scene(spec, assembly)
        palm = scene.wrist
        errors.change_model(scene.model, palm, scene.arm_dofs)
        assert np.isclose(scene.model.body_subtreemass[palm], exact.model.body_subtreemass[palm] * errors.payload)
        np.testing.assert_array_equal(scene.model.body_mass[:palm], exact.model.body_mass[:palm])
        np.testing.assert_allclose(scene.model.dof_damping[scene.arm_dofs],
                                   errors.friction * exact.model.dof_damping[exact.arm_dofs])
        data, reference = mujoco.MjData(scene.model), mujoco.MjData(exact.model)
        mujoco.mj_forward(scene.model, data)
        mujoco.mj_forward(exact.model, reference)
        moved = data.xpos[scene.tool] - reference.xpos[exact.tool]
        assert np.isclose(np.linalg.norm(moved), np.linalg.norm(errors.tool_shift), atol=1e-9)
        turned = relative_rotation(reference.xquat[exact.tool], data.xquat[scene.tool])
        assert np.isclose(np.degrees(np.linalg.norm(turned)), np.linalg.norm(errors.tool_turn_deg), atol=1e-6)
        np.testing.assert_allclose(scene.model.dof_frictionloss[scene.arm_dofs],
                                   errors.friction * exact.model.dof_frictionloss[exact.arm_dofs])
        servo = exact.assembly.robot.servo
        gains = errors.change_gains(Gains(np.array(servo.stiffness), np.array(servo.damping)))
        np.testing.assert_allclose(gains.stiffness, np.multiply(errors.stiffness, servo.stiffness))
        np.testing.assert_allclose(gains.damping, np.multiply(errors.damping, servo.damping))

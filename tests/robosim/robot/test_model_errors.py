"""Errors of the model change the simulated robot, and only where they should."""

import numpy as np

from mpm.geometry.rigid_motion import relative_rotation
from robosim.config.rehearsal import load_rehearsal
from robosim.rehearsal.run import make_cell
from robosim.robot.model import Arm
from robosim.robot.model_errors import FRICTION, GAINS, LATENCY, PAYLOAD, SHIFT, TURN_DEG, ModelErrors
from robosim.robot.model_errors import draw_model_errors as draw
from robosim.scene.build import assemble_rehearsal

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
    arm = Arm(assemble_rehearsal(config))
    exact = make_cell(config, arm, arm.home)
    for errors in (NONE, NONE._replace(payload=1.2, friction=np.linspace(0.5, 1.5, 7), stiffness=0.9, damping=1.1,
                                       tool_shift=np.array([1e-3, 0.0, 0.0]),
                                       tool_turn_deg=np.array([0.0, 0.3, 0.4]))):
        cell = make_cell(config, arm, arm.home, errors)
        palm, tool, dofs = cell.scene.wrist, cell.scene.tool, cell.scene.arm_dofs
        assert np.isclose(cell.model.body_subtreemass[palm], exact.model.body_subtreemass[palm] * errors.payload)
        np.testing.assert_array_equal(cell.model.body_mass[:palm], exact.model.body_mass[:palm])
        for key in ("dof_damping", "dof_frictionloss"):
            expected = errors.friction * getattr(exact.model, key)[dofs]
            np.testing.assert_allclose(getattr(cell.model, key)[dofs], expected)
        moved = cell.data.xpos[tool] - exact.data.xpos[tool]
        assert np.isclose(np.linalg.norm(moved), np.linalg.norm(errors.tool_shift), atol=1e-9)
        turned = relative_rotation(exact.data.xquat[tool], cell.data.xquat[tool])
        assert np.isclose(np.degrees(np.linalg.norm(turned)), np.linalg.norm(errors.tool_turn_deg), atol=1e-6)
        for key in ("stiffness", "damping"):
            expected = getattr(errors, key) * getattr(exact.servo.gains, key)
            np.testing.assert_allclose(getattr(cell.servo.gains, key), expected)

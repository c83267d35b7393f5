"""A tool that stands somewhere is approached with an open hand, and held by friction alone from there on."""

import mujoco
import numpy as np
import pytest
from bundled import plan_of

from robosim.config.rehearsal import APPROACH, RETREAT, load_rehearsal
from robosim.planning.picking import SETTLING
from robosim.planning.plan import plan_motion
from robosim.rehearsal.run import make_cell
from robosim.robot.mjspec import body_pose
from robosim.scene.build import compile_rehearsal
from robosim.scene.grasp import HOLDER, put_tool

CONFIG = load_rehearsal("pick_bottle")


@pytest.mark.parametrize("robot", ["iiwa14", "xarm7"])
def test_the_hand_comes_along_its_approach_direction(robot: str) -> None:
    """Straight, from the distance in the file, whatever the arm and the turn of the tool in its hand."""
    plan = plan_of("pick_bottle") if robot == CONFIG.robot else plan_motion(CONFIG.model_copy(update={"robot": robot}))
    assert plan.config.waypoints[0].name == APPROACH and plan.config.waypoints[1].dwell >= CONFIG.grasp_time
    scene = compile_rehearsal(plan.config)
    model, data = scene.model, mujoco.MjData(scene.model)
    places = []
    for name in (APPROACH, "standing"):
        data.qpos[scene.arm_qpos] = plan.motion.state(plan.path.rests[name][0]).q
        mujoco.mj_kinematics(model, data)
        site = data.site("hand_grip")
        places.append((site.xpos.copy(), site.xmat.reshape(3, 3).copy()))
    moved, approach = places[1][0] - places[0][0], places[1][1][:, 1]
    np.testing.assert_allclose(moved, CONFIG.pick.approach * approach, atol=1e-4)
    np.testing.assert_allclose(places[0][1], places[1][1], atol=1e-4)
    data.qpos[scene.arm_qpos] = plan.motion.state(0.0).q
    stand = plan.config.standing_pose
    put_tool(scene, data, stand)
    mujoco.mj_forward(model, data)
    reached = body_pose(data, scene.tool)
    np.testing.assert_allclose(reached.position, CONFIG.waypoints[0].position, atol=1e-9)
    np.testing.assert_allclose(reached.matrix, stand.matrix, atol=1e-9)
    assert not [c for c in data.contact if scene.tool in model.geom_bodyid[c.geom]]  # the open fingers do not touch it


def test_the_hand_goes_back_from_a_tool_that_it_sets_down() -> None:
    """From where the tool stands by the distance of the approach; it rests there until the fingers are open."""
    assert CONFIG.pick.set_down
    plan = plan_of("pick_bottle")
    (_, down, retreat), first = plan.config.waypoints[-3:], plan.config.waypoints[0]
    assert (down.name, retreat.name) == ("set_down", RETREAT)
    assert down.stop and down.dwell == pytest.approx(CONFIG.grasp_time + 2 * SETTLING)
    assert retreat.position == pytest.approx(first.position) and down.position == CONFIG.waypoints[0].position
    held = CONFIG.model_copy(update={"pick": CONFIG.pick.model_copy(update={"set_down": False})})
    assert plan_motion(held).config.waypoints[-1].name == "set_down"


def test_the_holder_keeps_a_tool_where_it_stands_until_the_fingers_hold_it() -> None:
    """At the stand with open fingers; closed and released, gravity and a push of 1 N displace it by less than 1 mm.

    When the fingers open again it stands by itself, and its slip is that of the grasp."""
    plan = plan_of("pick_bottle")
    target = plan.motion.state(plan.path.rests["standing"][0])
    cell, stand, slip = make_cell(plan.config, plan.arm, target.q), plan.config.standing_pose, 0.0
    scene, model, data, grasp = cell.scene, cell.model, cell.data, cell.grasp
    while data.time < 2.2:
        if data.time > 0.2:
            grasp.close(min((data.time - 0.2) / 0.3, 1.0))
        if data.time > 1.2:
            data.xfrc_applied[scene.tool] = 0.0
            grasp.open(min((data.time - 1.2) / 0.3, 1.0))
        elif data.time > 0.8:
            grasp.release()
            data.xfrc_applied[scene.tool, 2] = -1.0
            slip = grasp.slip
        elif data.time > 0.15:
            assert np.linalg.norm(data.xpos[scene.tool] - stand.position) < 5e-4
        cell.command(target)
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        grasp.measure_slip()
    assert not data.eq_active[model.equality(HOLDER).id]
    upright = data.xmat[scene.tool].reshape(3, 3) @ stand.matrix.T @ [0.0, 0.0, 1.0]
    pairs = [{model.body(b).name for b in model.geom_bodyid[contact.geom]} for contact in data.contact]
    assert [pair for pair in pairs if "bottle" in pair and pair != {"bottle", "stand"}] == [] and upright[2] > 0.9999
    assert {"bottle", "stand"} in pairs and 0.0 < slip < 1e-3 and grasp.slip - slip < 1e-4
    assert np.linalg.norm(data.xpos[scene.tool] - stand.position) < 2e-3

"""A tool held by the fingers alone, and what the arm's sensors make of a load."""

import mujoco
import numpy as np
import pytest

import mpm
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.robot.model import Arm
from robosim.robot.torque_sensors import TorqueSensors
from robosim.scene import clearance
from robosim.scene.build import ARM_JOINTS, Scene, compile_scene, compiled, rehearsal_spec
from robosim.scene.frames import body_pose, container_pose
from robosim.scene.grasp import HOLDER, Grasp

POSTURE = np.array([-0.9, 0.7, 0.45, -1.75, -0.78, -0.83, 1.8])


def hold(config: RehearsalConfig, load: np.ndarray, duration: float, swing: float = 0.0,
         ) -> tuple[Scene, mujoco.MjData, Grasp, np.ndarray]:
    """Hold the arm still, let the fingers close, take the stand away and hang a force [N] (3,) on the tool's centre;
    swing: from 0.7 s on all joints go there [rad] and back in 2 s."""
    scene = compile_scene(rehearsal_spec(config), config.tool)
    data = mujoco.MjData(scene.model)
    data.qpos[scene.arm_qpos] = POSTURE
    mujoco.mj_forward(scene.model, data)
    grasp = Grasp(scene.model, data, scene.tool)
    arm, before = Arm(config.tool), np.zeros(7)
    stiffness, damping = np.array(config.servo.stiffness), np.array(config.servo.damping)
    while data.time < duration:
        q, qd = data.qpos[scene.arm_qpos], data.qvel[scene.arm_dofs]
        phase = np.pi * max(data.time - 0.7, 0.0)
        wanted, rate = POSTURE + 0.5 * swing * (1.0 - np.cos(phase)), 0.5 * np.pi * swing * np.sin(phase)
        push = stiffness * (wanted - q) + damping * (rate - qd)
        data.ctrl[scene.arm_actuators] = push + arm.inverse_dynamics(q, 0 * q, 0 * q)
        if data.time < 0.5:
            grasp.close(min(data.time / 0.3, 1.0))
        else:
            grasp.release()
            data.xfrc_applied[scene.tool, :3] = load
        before = qd.copy()
        mujoco.mj_step(scene.model, data)
        mujoco.mj_kinematics(scene.model, data)
        grasp.watch()
    return scene, data, grasp, before


def test_fingers_hold_the_spoon_with_its_load() -> None:
    config = load_rehearsal("spoon").model_copy(update={"grasp": "friction"})
    scene, _, grasp, _ = hold(config, np.array([0.0, 0.0, -0.5]), 1.5)
    assert scene.model.nq == 23  # seven of the arm, nine of the hand, seven of a free tool
    assert grasp.holding
    assert 0.0 < grasp.slip < 0.001
    assert np.degrees(grasp.slip_angle) < 1.0


@pytest.mark.parametrize("name", ["spoon", "bottle"])
def test_what_friction_holds_does_not_creep_while_the_arm_moves(name: str) -> None:
    """All joints to and fro by 0.3 rad: as a free body the tool crept by 1 mm in a second, whatever the time step."""
    config = load_rehearsal(name).model_copy(update={"grasp": "friction"})
    settled = hold(config, np.zeros(3), 0.8)[2].slip
    assert settled < 0.0015
    _, data, grasp, _ = hold(config, np.zeros(3), 3.2, swing=0.3)  # ends half way, at speed
    assert grasp.holding and np.abs(data.qvel).max() > 0.1
    assert grasp.slip - settled < 0.0003


def test_contact_is_as_stiff_as_the_pads() -> None:
    """Not a mean with a metal handle's defaults, which would be softer: 3 N on a held scoop turn it by 0.02 deg, not
    0.05."""
    config = load_rehearsal("scoop").model_copy(update={"grasp": "friction"})
    angles = []
    for load in (0.0, -3.0):
        scene, data, grasp, _ = hold(config, np.array([0.0, 0.0, load]), 1.5)
        angles.append(np.degrees(grasp.slip_angle))
    assert 0.0 < angles[1] - angles[0] < 0.03
    model, pads = scene.model, ("f1_pad", "f2_pad", "fm_pad")
    held = [c for c in data.contact if model.geom(c.geom1).name in pads or model.geom(c.geom2).name in pads]
    assert held and all(c.solref == pytest.approx(model.geom("fm_pad").solref) for c in held)


def test_a_loose_tool_meets_the_palm() -> None:
    """Pushed up between the fingers, the handle stops where the palm begins."""
    config = load_rehearsal("spoon").model_copy(update={"grasp": "friction"})
    model = compile_scene(rehearsal_spec(config), config.tool).model
    data = mujoco.MjData(model)
    data.eq_active[model.equality(HOLDER).id] = 0
    palm = model.body("palm").id
    place = model.jnt_qposadr[model.body_jntadr[model.body("spoon").id]]
    mujoco.mj_kinematics(model, data)
    R = data.xmat[palm].reshape(3, 3)
    data.qpos[place : place + 3] = body_pose(data, model.body("spoon").id).matrix.T @ R @ [0.0, -0.1, 0.0]
    mujoco.mj_forward(model, data)
    touching = {frozenset((model.geom(c.geom1).name, model.geom(c.geom2).name)) for c in data.contact}
    assert frozenset(("palm_box", "spoon_handle")) in touching


def test_fixed_tool_does_not_slip() -> None:
    _, _, grasp, _ = hold(load_rehearsal("spoon"), np.array([0.0, 0.0, -5.0]), 0.7)
    assert not grasp.by_friction and grasp.slip == 0.0


def test_external_torque_is_that_of_the_load() -> None:
    """J^T F of a force on the spoon, at rest; without one next to nothing."""
    config = load_rehearsal("spoon")
    arm = Arm(config.tool)
    felt = {}
    for force in (0.0, -6.0):
        scene, data, _, before = hold(config, np.array([0.0, 2.0 * (force != 0), force]), 1.5)
        sensors = TorqueSensors(scene.model, data, ARM_JOINTS, arm)
        q, qd = data.qpos[scene.arm_qpos], data.qvel[scene.arm_dofs]
        felt[force] = sensors.external(q, before, (qd - before) / scene.model.opt.timestep)
    jacobian = np.empty((3, scene.model.nv))
    mujoco.mj_jacBodyCom(scene.model, data, jacobian, None, scene.tool)
    wanted = jacobian[:, scene.arm_dofs].T @ [0.0, 2.0, -6.0]
    assert np.abs(wanted).max() > 3.0
    assert felt[-6.0] - felt[0.0] == pytest.approx(wanted, abs=0.01 * np.abs(wanted).max())
    assert np.abs(felt[0.0]).max() < 0.2  # the closed fingers, which the model takes as open


def test_container_in_the_tool_is_counted_with_its_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball in the spoon's place is pushed 1 mm into the source's floor; clear of it nothing is counted; unasked,
    nothing is made."""
    monkeypatch.setattr(clearance, "tool_distance", lambda tool: mpm.Sdf.sphere(0.03))
    config = load_rehearsal("spoon")
    scene = compile_scene(rehearsal_spec(config), config.tool)
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    particles = clearance.RigidParticles(config)
    floor = container_pose(config.containers["source"])
    for height, touched in ((0.0301, False), (0.029, True)):
        particles.look(mpm.Pose(floor.position + [0.0, 0.0, height], np.array([1.0, 0.0, 0.0, 0.0])))
        assert (particles.count > 0) == touched
    assert particles.depth == pytest.approx(0.001, abs=1e-4)
    bare = config.model_copy(update={"tool_container": []})
    model = compiled(rehearsal_spec(bare))
    assert model.nexclude == scene.model.nexclude + 2
    assert clearance.Contacts(model, mujoco.MjData(model), bare).tool_container_depth == 0.0


TOUCHING = """
<mujoco>
  <worldbody>
    <body name="table"><geom type="box" size="1 1 0.01"/></body>
    <body name="bowl" pos="0.5 0 0.03"><geom type="box" size="0.05 0.05 0.02"/></body>
    <body name="link0"><geom type="sphere" size="0.02"/></body>
    <body name="link6" pos="0 0 {link}"><freejoint/><geom type="sphere" size="0.01"/></body>
    <body name="spoon" pos="{x} 0 {spoon}"><freejoint/><geom type="sphere" size="0.01"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(("link", "x", "spoon", "container", "surroundings"), [
    (0.2, 0.3, 0.2, 0, 0), (0.019, 0.3, 0.2, 0, 1), (0.2, 0.3, 0.019, 0, 1), (0.2, 0.5, 0.059, 1, 0),
    (0.019, 0.5, 0.059, 1, 1),
])
def test_who_touches_whom_is_counted(link: float, x: float, spoon: float, container: int, surroundings: int) -> None:
    """The arm's foot stands on the table; any other of its parts, and the tool, must not touch it; a tool in a
    container is another matter."""
    model = mujoco.MjModel.from_xml_string(TOUCHING.format(link=link, x=x, spoon=spoon))
    data = mujoco.MjData(model)
    touches = clearance.Touches(model, data, "spoon", {"bowl"})
    mujoco.mj_forward(model, data)
    for times in (1, 2):
        touches.count()
        assert (touches.tool_container, touches.robot_surroundings) == (times * container, times * surroundings)
    touches.restart()
    assert touches.tool_container == touches.robot_surroundings == 0

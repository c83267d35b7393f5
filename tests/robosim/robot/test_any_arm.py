"""Kinematics, dynamics, servo and planning of arms of any number of joints, bundled, written and from elsewhere."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from written_arms import write_arm, write_urdf

from mpm import Pose
from mpm.geometry.rigid_motion import relative_rotation
from robosim.base.errors import ConfigError, RobotDiverged, UnknownName
from robosim.base.resources import part_names
from robosim.cell.cell import Cell
from robosim.config.arm import ArmConfig
from robosim.planning.clearance import RobotClearance
from robosim.robot.assembly import HAND_PREFIX, WRIST_SITE, Assembly, add_sensors
from robosim.robot.hand import load_hand
from robosim.robot.inverse_kinematics import solve_pose
from robosim.robot.mjspec import compile_spec
from robosim.robot.model import Arm
from robosim.robot.robot import load_robot_model
from robosim.robot.timing import JointState
from robosim.scene.build import build_scene_spec
from robosim.scene.compiled import compile_scene
from robosim.scene.models import assemble

POSES, RESTARTS = 200, 60
STAND = Pose(np.array([0.1, -0.2, 0.3]),
             Rotation.from_euler("xyz", [10.0, 20.0, 30.0], degrees=True).as_quat(scalar_first=True))


def make(kind: str, path: Path, **keys: Any) -> Assembly:
    """Return a bundled arm that stands askew, or one with so many joints, with a spoon in its hand."""
    if not kind.isdigit():
        bundled = assemble("spoon", kind)
        return replace(bundled, robot=replace(bundled.robot, stand=STAND))
    file = write_arm(path / "arm.xml", int(kind), slide=1 if kind == "8" else None)
    config = ArmConfig.model_validate({"model": str(file), "flange": "tip", "limits": {"velocity": [2.0] * int(kind)},
                                       **keys})
    return replace(assemble("spoon", gripper="none"), robot=replace(load_robot_model(config, path), stand=STAND))


@pytest.mark.parametrize("kind", [*part_names("robots"), "5", "8"])
def test_reachable_poses_are_solved_and_mujoco_confirms_them(kind: str, tmp_path: Path) -> None:
    """At least 99.5 %, with restarts; pose, gravity torques and Jacobian are MuJoCo's."""
    assembly = make(kind, tmp_path)
    arm, spec, rng = Arm(assembly), mujoco.MjSpec(), np.random.default_rng(3)
    assembly.attach_to(spec)
    model = compile_spec(spec)
    data = mujoco.MjData(model)
    places = [model.joint(name).qposadr[0] for name in arm.joints]
    dofs = [model.joint(name).dofadr[0] for name in arm.joints]
    middle, half = 0.5 * (arm.lower + arm.upper), 0.5 * (arm.upper - arm.lower)
    failed = 0
    for _ in range(POSES):
        target = arm.tool_pose(middle + half * rng.uniform(-1.0, 1.0, len(half)))
        for attempt in range(RESTARTS):
            start = middle + (attempt > 0) * 0.9 * half * rng.uniform(-1.0, 1.0, len(half))
            solution = solve_pose(arm, target, start, middle)
            if solution.converged:
                break
        failed += not solution.converged
        data.qpos[places] = solution.q
        mujoco.mj_forward(model, data)
        reached, own = data.body("spoon"), arm.tool_pose(solution.q)
        assert np.linalg.norm(reached.xpos - own.position) < 1e-9
        assert np.linalg.norm(relative_rotation(own.quaternion, reached.xquat)) < 1e-7
        assert (solution.q >= arm.lower).all() and (solution.q <= arm.upper).all()
    assert failed <= 0.005 * POSES
    still = np.zeros(len(arm.joints))
    assert arm.inverse_dynamics(solution.q, still, still) == pytest.approx(data.qfrc_bias[dofs], abs=1e-6)
    jacobian = np.zeros((2, 3, model.nv))
    mujoco.mj_jacBody(model, data, *jacobian, model.body("spoon").id)
    R = data.body("spoon").xmat.reshape(3, 3)
    expected = np.concatenate([R.T @ part[:, dofs] for part in jacobian])
    assert arm.jacobian(solution.q) == pytest.approx(expected, abs=1e-6)


def make_cell(path: Path, dt: float, damping: float = 0.0, servo: dict[str, Any] | None = None) -> Cell:
    """Return an arm of light links without armature, whose joints have so much passive damping."""
    assembly = make("6", path, servo=servo)
    for joint in assembly.robot.joints:
        assembly.robot.spec.joint(joint).damping = [damping, 0.0, 0.0]
    scene, arm = compile_scene(build_scene_spec(assembly, "weld", {}, dt, contact=False), assembly), Arm(assembly)
    return Cell(scene, arm, arm.home, ())


def move(cell: Cell, dt: float, steps: int, swing: float, speed: float) -> tuple[float, float]:
    """Swing all joints by an angle [rad] in a second, from a speed [rad/s]; return largest error [m], last speed."""
    errors, speeds, w, ones = [], [], 2.0 * np.pi, 0.5 * swing * np.ones(6)
    cell.data.qpos[cell.scene.arm_qpos], cell.data.qvel[cell.scene.arm_dofs] = cell.arm.home, speed
    for t in dt * np.arange(steps):
        target = JointState(cell.arm.home + ones * (1.0 - np.cos(w * t)), w * ones * np.sin(w * t),
                            w * w * ones * np.cos(w * t))
        errors.append(np.linalg.norm(cell.arm.tool_pose(cell.q).position - cell.arm.tool_pose(target.q).position))
        cell.command(target)
        mujoco.mj_step(cell.model, cell.data)
        speeds.append(cell.qd.copy())
        if len(speeds) % 20 == 0:
            cell.servo.check_motion(cell.data.time, np.array(speeds[-20:]))
    return max(errors), np.abs(speeds[-1]).max()


@pytest.mark.parametrize(("dt", "damping", "most"), [(1e-4, 0.0, 2e-5), (1e-3, 0.0, 2e-4), (1e-3, 5.0, 2e-4),
                                                     (5e-3, 0.0, 4e-3)])
def test_the_default_servo_follows_and_allows_a_fifth_of_the_inertia(dt: float, damping: float, most: float,
                                                                     tmp_path: Path) -> None:
    """In every posture."""
    cell = make_cell(tmp_path, dt, damping)
    assert move(cell, dt, round(1.0 / dt), 0.5, 0.0)[0] < most and cell.servo.saturations == 0
    cell.model.body_mass *= 0.2
    cell.model.body_inertia *= 0.2
    cell.check_path(np.random.default_rng(0).uniform(cell.arm.lower, cell.arm.upper, (50, 6)))


@pytest.mark.parametrize("servo", [{"bandwidth": 30.0, "damping_ratio": 0.7},
                                   {"stiffness": [1e-2] * 6, "damping": [0.05, 0.5, 0.05, 0.5, 0.05, 0.2]}])
def test_a_servo_is_stable_up_to_the_checked_bound_and_no_further(servo: dict[str, Any], tmp_path: Path) -> None:
    """MuJoCo decides about the largest factor on the gains by 2 dt d + dt^2 k = 4; the unstable joint is named."""
    cell, dt = make_cell(tmp_path, 1e-3, servo=servo), 1e-3
    inertia = np.eye(6) if cell.servo.gains.per_inertia else cell.arm.inertia(cell.arm.home)
    k, d = (np.linalg.eigvals(np.linalg.solve(inertia, np.diag(gain))).real.max() for gain in cell.servo.gains[:2])
    most = 4.0 / (2.0 * dt * d + dt * dt * k)
    cell.servo.scale(0.97 * most, 0.97 * most)
    cell.check_path([cell.arm.home])
    assert move(cell, dt, 500, 0.0, 1e-4)[1] < 2e-5
    cell.servo.scale(1.03 * most, 1.03 * most)
    with pytest.raises(RobotDiverged, match=r"the servo of joint j. \(.*\) is unstable in steps of host_dt = 0.001 s"):
        move(cell, dt, 500, 0.0, 1e-4)
    with pytest.raises(ConfigError, match=r"host_dt = 0.001 s: the servo of joint j. \(.* needs steps below 0.0009"):
        cell.check_path([cell.arm.home])


@pytest.mark.parametrize("robot", part_names("robots"))
@pytest.mark.parametrize("gripper", [*part_names("grippers"), "none"])
def test_hands_hold_a_tool_in_one_orientation(robot: str, gripper: str) -> None:
    """Whatever is between flange and tool; the wrist carries hand and tool, and the sensor lies at the flange."""
    assembly = assemble("spoon", robot, gripper)
    spec = assembly.build_spec()
    add_sensors(spec, assembly)
    model = compile_spec(spec)
    data = mujoco.MjData(model)
    data.qpos[[model.joint(name).qposadr[0] for name in assembly.robot.joints]] = assembly.robot.home
    mujoco.mj_forward(model, data)
    flange, grip = (data.site(name).xmat.reshape(3, 3) for name in (assembly.robot.flange, "spoon_grip"))
    expected = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # y of the grip is z of the flange
    np.testing.assert_allclose(flange.T @ grip, expected, atol=1e-6)
    offset = flange.T @ (data.site("spoon_grip").xpos - data.site(assembly.robot.flange).xpos)
    assert np.abs(offset[:2]).max() < 1e-6 and 0.09 < offset[2] < 0.17
    assert np.linalg.norm(data.site(WRIST_SITE).xpos - data.site(assembly.robot.flange).xpos) < 1e-6
    carried = model.body_subtreemass[model.body(assembly.wrist).id]
    assert carried > model.body("spoon").mass[0] and data.ncon == 0


def test_a_turn_in_the_hand_is_about_the_handle() -> None:
    straight, turned = (assemble("spoon", "iiwa14", grip_turn_deg=angle) for angle in (0.0, 40.0))
    poses = []
    for assembly in (straight, turned):
        model = compile_spec(assembly.build_spec())
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        poses.append((data.site("spoon_grip").xpos.copy(), data.site("spoon_grip").xmat.reshape(3, 3).copy()))
    assert np.linalg.norm(poses[1][0] - poses[0][0]) < 1e-9
    turn = Rotation.from_matrix(poses[0][1].T @ poses[1][1]).as_rotvec(degrees=True)
    np.testing.assert_allclose(turn, [0.0, 0.0, 40.0], atol=1e-6)


def test_hands_are_files(tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_text('<mujoco><worldbody><body name="base"><geom size="0.02"/><site name="g"/>'
                                       '<body><joint name="j" type="slide"/><geom size="0.01"/></body></body>'
                                       '</worldbody><actuator><position name="a" joint="j"/></actuator></mujoco>')
    path, text = tmp_path / "hand.yaml", "model: hand.xml\ngrip: g\nopen: {a: 0.1}\nclosed: {a: 0.0}\n"
    path.write_text(text)
    hand = load_hand(str(path))
    assert hand is not None and hand.base == "base"
    assert assemble("spoon", "iiwa14", str(path)).wrist == HAND_PREFIX + "base"
    for old, new, error, message in (("grip: g", "grip: h", UnknownName, "grip 'h'; valid: base, g, .*"),
                                     ("open: {a", "open: {b", ConfigError, "accepted: the same actuators"),
                                     ("{a: 0.1}", "{c: 0.1}", ConfigError, "accepted: the same actuators")):
        path.write_text(text.replace(old, new))
        with pytest.raises(error, match=message):
            load_hand(str(path))
    path.write_text(text.replace("a:", "b:"))
    with pytest.raises(UnknownName, match="actuator 'b'; valid: a"):
        load_hand(str(path))
    with pytest.raises(UnknownName, match="gripper 'claw'; valid: none, parallel_jaw, robotiq_3f"):
        load_hand("claw")
    with pytest.raises(ConfigError, match="no such file; accepted: a .yaml file of your own, or one of parallel_jaw"):
        load_hand(str(tmp_path / "no.yaml"))


def test_a_urdf_with_fixed_frames_is_an_arm(tmp_path: Path) -> None:
    """Base and flange are links without a joint, which MuJoCo would fuse; poses and gravity torques are MuJoCo's.

    It says its limits of speed and torque."""
    write_urdf(tmp_path / "lab.urdf")
    robot = load_robot_model(ArmConfig.model_validate({"model": "lab.urdf", "flange": "tool0"}), tmp_path)
    assert robot.base == "base_link" and robot.joints == tuple(f"q{k}" for k in range(6))
    assert robot.sources["velocity"] == "model" and robot.velocity == pytest.approx(np.arange(6) + 0.5)
    assert robot.torque == pytest.approx(np.arange(6) + 100.0)
    assembly = replace(assemble("spoon", "iiwa14", "parallel_jaw"), robot=replace(robot, stand=STAND))
    check_against_mujoco(assembly)
    compiled = compile_scene(build_scene_spec(assembly, "weld", {}, 1e-3, contact=True), assembly)
    clearance = RobotClearance(compiled, Arm(assembly)).measure(robot.home)
    assert np.isfinite(clearance[0].distance) and np.isfinite(clearance[1].distance)


def check_against_mujoco(assembly: Assembly) -> None:
    """Compare the tool's pose, mass matrix and bias of both models in a posture off the home."""
    arm, spec = Arm(assembly), mujoco.MjSpec()
    assembly.attach_to(spec)
    model = compile_spec(spec)
    data, q, qd = mujoco.MjData(model), arm.home + 0.1, np.linspace(0.3, 1.0, len(arm.home))
    dofs = [model.joint(name).dofadr[0] for name in arm.joints]
    data.qpos[[model.joint(name).qposadr[0] for name in arm.joints]], data.qvel[dofs] = q, qd
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(arm.tool_pose(q).position, data.body("spoon").xpos, atol=1e-10)
    np.testing.assert_allclose(arm.tool_pose(q).matrix, data.body("spoon").xmat.reshape(3, 3), atol=1e-10)
    M, bias = np.zeros((model.nv, model.nv)), arm.rigid_torque(q, qd, 0.0 * q)
    mujoco.mj_fullM(model, data, M)
    np.testing.assert_allclose(bias, data.qfrc_bias[dofs], atol=1e-10 * np.abs(data.qfrc_bias).max())
    own = [arm.inverse_dynamics(q, 0.0 * q, one) - arm.inverse_dynamics(q, 0.0 * q, 0.0 * q) for one in np.eye(len(q))]
    np.testing.assert_allclose(own, M[np.ix_(dofs, dofs)], atol=1e-10 * M.max())


def test_frames_names_and_compensation_of_a_foreign_model(tmp_path: Path) -> None:
    """Enclosing frames, bodies without names or with a joint's, gravity compensation, limits of the configuration."""
    path = write_arm(tmp_path / "arm.xml", 6)
    text = path.read_text().replace('<body name="stand">', '<frame pos="0.3 0 0.1" euler="0 0 40"><body name="stand">')
    text = text.replace('name="l2"', "").replace('name="l3"', 'name="j3" gravcomp="1"')
    site = '<site name="tip" pos="0 0 0.25"/>'
    text = text.replace(site, f'<frame euler="50 0 0">{site}</frame>')
    path.write_text(text.replace("</worldbody>", "</frame></worldbody>"))
    robot = load_robot_model(ArmConfig.model_validate({
        "model": "arm.xml", "flange": "tip", "limits": {"velocity": [2.0] * 6, "torque": [77.0] * 6,
                                                        "upper_deg": [90.0] * 6}}), tmp_path)
    for gripper in ("parallel_jaw", "none"):
        assembly = replace(assemble("spoon", "iiwa14", gripper), robot=robot)
        check_against_mujoco(assembly)
        model = compile_spec(assembly.build_spec())
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        flange = data.site("tip").xmat.reshape(3, 3)
        link = data.body("l5").xmat.reshape(3, 3)
        np.testing.assert_allclose(link.T @ flange, Rotation.from_euler("x", 50.0, degrees=True).as_matrix(), atol=1e-9)
        for name in robot.joints:
            assert model.joint(name).range[1] == pytest.approx(np.radians(90.0))
            assert model.jnt_actfrcrange[model.joint(name).id] == pytest.approx([-77.0, 77.0])

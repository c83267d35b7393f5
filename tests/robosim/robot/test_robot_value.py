"""Any serial arm of five to eight joints is read, with its limits from the model or the configuration, and refused by
name where something is missing."""

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from written_arms import write_arm

from robosim.base.errors import ConfigError, UnknownName
from robosim.base.resources import part_names
from robosim.config.arm import ArmConfig
from robosim.robot.assembly import CLAMP_MASS, Assembly, add_sensors
from robosim.robot.mjspec import compile_spec, locate_model
from robosim.robot.model import Arm
from robosim.robot.robot import load_arm, load_robot_model
from robosim.scene.build import build_scene_spec
from robosim.scene.models import assemble

ROOT = Path(__file__).resolve().parents[3]


def read(path: Path, **more: Any) -> Any:
    return load_robot_model(ArmConfig.model_validate({"model": path.name, "flange": "tip", **more}), path.parent)


@pytest.mark.parametrize("joints", [5, 8])
@pytest.mark.parametrize("actuator", ["position", "velocity", "motor"])
def test_arms_of_five_to_eight_joints_are_read(joints: int, actuator: str, tmp_path: Path) -> None:
    extra = 'kp="10" ' if actuator == "position" else ""
    path = write_arm(tmp_path / "arm.xml", joints, actuator=actuator)
    path.write_text(path.read_text().replace(f"<{actuator} joint", f"<{actuator} {extra}joint"))
    robot = read(path, limits={"velocity": [2.0] * joints})
    assert robot.joints == tuple(f"j{k}" for k in range(joints)) and robot.base == "stand" and robot.flange == "tip"
    np.testing.assert_allclose(robot.torque, 2.0 * (20.0 + np.arange(joints)))
    np.testing.assert_allclose(np.degrees([robot.lower, robot.upper]), [[-100.0] * joints, [120.0] * joints])
    np.testing.assert_allclose(np.degrees(robot.home), 10.0)
    assert robot.sources == {"lower_deg": "model", "upper_deg": "model", "torque": "model", "velocity": "configuration",
                             "acceleration": "assumed", "jerk": "assumed", "servo": "assumed"}
    model = robot.spec.copy().compile()
    assert model.nkey == 0 and model.nu == joints + 1  # the finger keeps its own
    for k, name in enumerate(robot.joints):
        data = mujoco.MjData(model)
        data.ctrl[model.actuator(name).id] = 1e6
        mujoco.mj_forward(model, data)
        assert data.qfrc_actuator[model.joint(name).dofadr[0]] == pytest.approx(robot.torque[k])


def test_what_the_configuration_says_holds_before_what_the_model_says(tmp_path: Path) -> None:
    path = write_arm(tmp_path / "arm.xml", 6, slide=2)
    robot = read(path, home_deg=[0, 0, 100, 0, 0, 0], payload=5.0, limits={
        "velocity": [1, 2, 3, 4, 5, 6], "acceleration": [10] * 6, "jerk": [99] * 6, "torque": [7] * 6,
        "lower_deg": [-10, -10, -50, -10, -10, -10]}, servo={"stiffness": [100] * 6, "damping": [1] * 6})
    assert robot.home[2] == pytest.approx(0.1) and robot.lower[2] == pytest.approx(-0.05)  # millimetres
    assert robot.upper[2] == pytest.approx(0.3) and robot.torque.tolist() == [7] * 6
    assert [key for key, source in robot.sources.items() if source != "configuration"] == ["upper_deg"]
    assert robot.servo.stiffness == (100.0,) * 6


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    speeds = {"velocity": [2.0] * 6}
    arm = write_arm(tmp_path / "arm.xml", 6)
    cases: list[tuple[Path, dict[str, Any], str]] = [
        (arm, {}, "has no velocity of j0, j1, j2, j3, j4, j5; accepted"),
        (arm, {"limits": {"velocity": [1.0] * 5}}, "velocity has 5 values; accepted: 6"),
        (arm, {"limits": speeds, "home_deg": [0, 0, 0, 130, 0, 0]}, "home_deg: joint j3 = 2.269; accepted: -1.745"),
        (write_arm(tmp_path / "free.xml", 6, limited=False), {"limits": speeds}, "no lower_deg of j0.*; upper"),
        (write_arm(tmp_path / "short.xml", 4), {}, "4 joints between base and flange .* accepted: 5 to 8"),
        (write_arm(tmp_path / "nameless.xml", 6, named=False), {}, "torque of joint_1, .*; velocity of joint_1"),
        (tmp_path / "none.xml", {}, "no such file; accepted: a model of MuJoCo"),
    ]
    (tmp_path / "text.xml").write_text("no model")
    cases.append((tmp_path / "text.xml", {}, "cannot be read as a model"))
    for path, more, message in cases:
        with pytest.raises(ConfigError, match=message):
            read(path, **more)
    with pytest.raises(UnknownName, match="flange 'fingr'; valid: finger, l0.*tip; did you mean 'finger'"):
        read(arm, flange="fingr")


def test_models_of_others_are_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of robot_descriptions, which is stood in for, and of a folder that looks like Menagerie; else what is missing."""
    arm = write_arm(tmp_path / "ur5e.xml", 6)
    package, found, textual = (ModuleType(f"robot_descriptions{part}")
                               for part in ("", ".a_description", ".b_description"))
    found.MJCF_PATH = str(arm)  # pyright: ignore[reportAttributeAccessIssue]
    package.__path__ = []
    for name in ("robot_descriptions", "robot_descriptions.a_description"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(ConfigError, match="model a_description: of the package robot_descriptions; pip install"):
        locate_model("a_description", tmp_path)
    for module in (package, found, textual):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    assert locate_model("a_description", Path("elsewhere")) == arm
    for name, message in (("b_description", "neither an MJCF nor a URDF"), ("c_description", "a name of that package")):
        with pytest.raises(ConfigError, match=message):
            locate_model(name, tmp_path)
    monkeypatch.delenv("MUJOCO_MENAGERIE", raising=False)
    with pytest.raises(ConfigError, match="menagerie:ur: MUJOCO_MENAGERIE = ''; accepted: the folder"):
        locate_model("menagerie:ur", tmp_path)
    monkeypatch.setenv("MUJOCO_MENAGERIE", str(tmp_path))
    for folder, names in (("one", ("ur5e",)), ("two", ("panda", "panda_nohand"))):
        (tmp_path / folder).mkdir()
        for name in ("scene", *names):
            (tmp_path / folder / f"{name}.xml").write_text(arm.read_text())
    assert locate_model("menagerie:one", Path()) == tmp_path / "one" / "ur5e.xml"
    assert locate_model("menagerie:two/panda", Path()) == tmp_path / "two" / "panda.xml"
    for name, message in (("three", "model of the Menagerie 'three'; valid: one, two"),
                          ("two", "two/FILE ''; valid: panda, panda_nohand"), ("two/fr3", "two/FILE 'fr3'")):
        with pytest.raises(UnknownName, match=message):
            locate_model(f"menagerie:{name}", Path())


DH = {  # a(i-1), alpha(i-1) [deg], d(i) of the modified convention; the last row is the flange
    "panda": [(0, 0, 0.333), (0, -90, 0), (0, 90, 0.316), (0.0825, 90, 0), (-0.0825, -90, 0.384), (0, 90, 0),
              (0.088, 90, 0), (0, 0, 0.107)],
    "xarm7": [(0, 0, 0.267), (0, -90, 0), (0, 90, 0.293), (0.0525, 90, 0), (0.0775, 90, 0.3425), (0, 90, 0),
              (0.076, -90, 0), (0, 0, 0.097)],
    "gen3": [(0, 180, -0.28481), (0, 90, -0.01175), (0, -90, -0.42076), (0, 90, -0.01275), (0, -90, -0.31436),
             (0, 90, -0.0003501), (0, -90, -0.167455), (0, 180, 0)],
    "ur5e": [(0, 0, 0.1625), (0, 90, 0), (-0.425, 0, 0), (-0.3922, 0, 0.1333), (0, 90, 0.0997), (0, -90, 0.0996),
             (0, 0, 0)],
}
"""Published by the makers: Franka Control Interface, UFACTORY documentation, UR article, Kinova's URDF."""
BASE_TURN = {"ur5e": np.pi}
"""Turn [rad] about z from our base, whose x is forward, to that of the parameters: UR's `Base` looks backward."""
TOTAL_MASS = {"gen3": 8.2, "iiwa14": 29.9, "panda": 18.0, "ur5e": 20.6, "xarm7": 13.7}
"""Data sheets [kg]."""


def dh_pose(rows: list[tuple[float, float, float]], q: np.ndarray) -> np.ndarray:
    """Return the flange's pose (4, 4) by modified DH parameters."""
    pose = np.eye(4)
    for (a, alpha, d), theta in zip(rows, [*q, 0.0]):
        ca, sa, ct, st = np.cos(np.radians(alpha)), np.sin(np.radians(alpha)), np.cos(theta), np.sin(theta)
        pose = pose @ [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
    return pose


@pytest.mark.parametrize("name", DH)
def test_bundled_arms_have_the_makers_kinematics(name: str) -> None:
    robot, rng = load_arm(name), np.random.default_rng(0)
    model = robot.spec.copy().compile()
    data, site = mujoco.MjData(model), model.site(robot.flange).id
    address, turn = [model.joint(joint).qposadr[0] for joint in robot.joints], Rotation.from_rotvec(
        [0.0, 0.0, BASE_TURN.get(name, 0.0)])
    for _ in range(20):
        q = rng.uniform(robot.lower, robot.upper)
        data.qpos[address] = q
        mujoco.mj_kinematics(model, data)
        expected = turn.apply(dh_pose(DH[name], q)[:3, 2:].T)  # the flange's z axis, and its place
        np.testing.assert_allclose(data.site_xmat[site].reshape(3, 3)[:, 2], expected[0], atol=1e-9)
        np.testing.assert_allclose(data.site_xpos[site], expected[1], atol=1e-9)


@pytest.mark.parametrize("name", TOTAL_MASS)
def test_bundled_arms_are_complete(name: str) -> None:
    """Mass of the data sheet, valid inertias, a home posture without contact whose flange looks down or ahead."""
    assert name in part_names("robots")
    robot = load_arm(name)
    assert set(robot.sources.values()) <= {"model", "configuration"} and robot.payload and len(robot.joints) >= 6
    model = robot.spec.copy().compile()
    assert model.body_mass.sum() == pytest.approx(TOTAL_MASS[name], rel=0.03)
    inertias = model.body_inertia[1:]
    assert (inertias > 0.0).all() and (2.0 * inertias.max(1) <= inertias.sum(1) * (1.0 + 1e-9)).all()
    data = mujoco.MjData(model)
    data.qpos[[model.joint(joint).qposadr[0] for joint in robot.joints]] = robot.home
    mujoco.mj_forward(model, data)
    assert data.ncon == 0 and data.site_xmat[model.site(robot.flange).id].reshape(3, 3)[2, 2] < 1e-6
    reach = np.minimum(robot.home - robot.lower, robot.upper - robot.home)
    assert np.degrees(reach).min() > 20.0
    sizes = sum(path.stat().st_size for path in (ROOT / "models/robots" / name).rglob("*.stl"))
    assert name == "iiwa14" or sizes < 260_000


def test_limits_are_the_data_sheets() -> None:
    """KUKA LBR iiwa 14 R820 data sheet: ranges, speeds and torques, read back from both compiled models."""
    assembly = assemble("spoon")
    model, arm = compile_spec(assembly.build_spec()), Arm(assembly)
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


def test_an_arm_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match="robot 'ur10'; valid: gen3, iiwa14, panda, ur5e, xarm7, or the path"):
        load_arm("ur10")
    with pytest.raises(ConfigError, match="no such file; accepted: a .yaml file of your own, or one of gen3"):
        load_arm(str(tmp_path / "mine.yaml"))


def test_defaults_and_options_of_the_model_are_of_its_own_elements(tmp_path: Path) -> None:
    """Motors, flange, clamp and sensors are the same whatever the arm's file sets for what it does not spell out."""
    path = write_arm(tmp_path / "plain.xml", 6)
    hostile = ('<compiler inertiagrouprange="0 1" boundmass="5"/><default><motor gear="100"/><site euler="0 90 0"/>'
               '<geom euler="90 0 0" margin="0.01"/><equality solref="0.5 1"/><default class="arm"/></default>')
    text = path.read_text().replace("<mujoco>", f"<mujoco>{hostile}")
    (tmp_path / "hostile.xml").write_text(text.replace('name="stand"', 'name="stand" childclass="arm"'))
    models = []
    for name in ("plain.xml", "hostile.xml"):
        robot = load_robot_model(ArmConfig.model_validate({
            "model": name, "flange": "l5", "limits": {"velocity": [1.0] * 6}}), tmp_path)
        assembly, spec = Assembly(robot, None, None), mujoco.MjSpec()
        assembly.attach_to(spec)
        add_sensors(spec, assembly)
        models.append(compile_spec(spec))
    first, second = models
    assert [second.actuator(name).gear[0] for name in robot.joints] == [1.0] * 6
    for name in ("l5", "wrist_sensor", *(f"{joint}_torque_site" for joint in robot.joints)):
        np.testing.assert_allclose(second.site(name).quat, first.site(name).quat, atol=1e-12)
    for key in ("mass", "inertia", "iquat"):
        np.testing.assert_allclose(getattr(second.body("hand_clamp"), key), getattr(first.body("hand_clamp"), key))
    assert first.body("hand_clamp").mass == CLAMP_MASS


@pytest.mark.parametrize("name", ["hand_clamp", "table"])
def test_a_link_named_like_a_part_of_the_scene_is_refused_with_the_remedy(tmp_path: Path, name: str) -> None:
    path = write_arm(tmp_path / "arm.xml", 6)
    path.write_text(path.read_text().replace('name="l2"', f'name="{name}"'))
    robot = read(path, limits={"velocity": [1.0] * 6})
    with pytest.raises(ConfigError, match=f"repeated name '{name}' in body; .* rename it in one of the models"):
        compile_spec(build_scene_spec(Assembly(robot, None, None), "weld", {}, 0.001, contact=False))

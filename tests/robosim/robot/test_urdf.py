"""Descriptions as laboratories have them: ROS packages, mimic joints, zeros, hands; read, or refused by name."""

import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
from written_arms import write_arm, write_urdf

from robosim.base.errors import ConfigError, RobosimWarning
from robosim.commands.main import main
from robosim.commands.new import draft_arm
from robosim.config.arm import ArmConfig
from robosim.robot.assembly import Assembly
from robosim.robot.mjspec import compile_spec
from robosim.robot.robot import load_arm, load_robot_model
from robosim.scene.models import assemble

BOX, LIMIT = '<box size="0.1 0.1 0.1"/>', 'lower="-2.5" upper="2.5" effort="10%d" velocity="%d.5"/>'
DRAWN = '<mujoco><compiler discardvisual="false"/></mujoco></robot>'


def read(path: Path, **more: Any) -> Any:
    return load_robot_model(ArmConfig.model_validate({"model": path.name, "flange": "tool0", **more}), path.parent)


@pytest.mark.parametrize(("urdf", "package", "address"), [
    ("lab_description/urdf/a.urdf", "lab_description", "package://lab_description/"),
    ("robots/Arm ü.urdf", "lab_description", "package://lab_description/"),
    ("renamed-main/urdf/a.urdf", "renamed-main", "model://lab_description/"),
    ("robots/a.urdf", "elsewhere/lab_description", "package://lab_description/"),
    ("robots/a.urdf", "install/share/lab_description", "package://lab_description/"),
    ("robots/a.urdf", "my folder", "file://{root}/my folder/"), ("robots/a.urdf", "my folder", "../my folder/"),
])
@pytest.mark.parametrize("by_key", [True, False])
def test_meshes_are_found_each_its_own(urdf: str, package: str, address: str, by_key: bool, tmp_path: Path,
                                       monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of one name in three folders, with spaces, upper case and other letters; packages by folder or key."""
    root, shapes = tmp_path / package, ""
    for folder, size in (("visual", 1.0), ("collision", 0.1), ("more", 0.2)):
        (root / folder).mkdir(parents=True)
        trimesh.creation.box([size] * 3).export(root / folder / "Größe 1.STL", file_type="stl")
        kind = "visual" if folder == "visual" else "collision"
        mesh = f'<mesh filename="{address.format(root=tmp_path)}{folder}/Größe 1.STL"/>'
        shapes += f"<{kind}><geometry>{mesh}</geometry></{kind}>"
    (root / "package.xml").write_text("<package><name> lab_description </name></package>")
    plain = f"<collision><geometry>{BOX}</geometry></collision>"
    path = write_urdf(tmp_path / urdf, (plain, shapes), ("</robot>", DRAWN))
    (tmp_path / "arm.yaml").write_text(f"model: '{urdf}'\nflange: tool0\npackages: {{lab_description: {package}}}\n"
                                       f"limits: {{velocity: [1, null, null, null, null, null]}}\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(["", str(tmp_path / "elsewhere")]))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    monkeypatch.chdir("/")
    robot = load_arm(str(tmp_path / "arm.yaml")) if by_key else read(path, limits={"velocity": [1] + [None] * 5})
    model = compile_spec(Assembly(robot, None, None).build_spec())
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    sizes = sorted((int(model.geom_contype[g]), round(2.0 * float(model.geom_aabb[g, 3]), 6)) for g in meshes)
    assert sizes == [(0, 1.0), (1, 0.1), (1, 0.2)] and robot.velocity.tolist() == [1.0, 1.5, 2.5, 3.5, 4.5, 5.5]


@pytest.mark.parametrize(("address", "message"), [
    ("package://no/m.stl", "mesh package://no/m.stl: not found, .*/no/m.stl.* or of the key packages: .NAME: FOLDER"),
    ("m.stl", "mesh m.stl: not found, not as /.*/m.stl"), ("http://x/m.stl", "mesh http://x/m.stl: not found"),
    (f"package://{300 * 'p'}/m.stl", "mesh package://p+/m.stl: not found"), (300 * "m", "mesh m+: not found"),
    ("own.dae", "link base_link: collision mesh .*own.dae; accepted: .stl, .obj, .msh")])
def test_meshes_that_cannot_be_read_are_named(address: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "own.dae").touch()
    with pytest.raises(ConfigError, match=f"a.urdf: {message}"):
        read(write_urdf(tmp_path / "a.urdf", (BOX, f'<mesh filename="{address}"/>')))


@pytest.mark.parametrize("end", ["</robot>", DRAWN])
def test_visual_shapes_that_are_left_out_are_noted(end: str, tmp_path: Path) -> None:
    (tmp_path / "own.dae").touch()
    visual = '<visual><geometry><mesh filename="own.dae"/></geometry></visual></link><link name="l0"'
    path = write_urdf(tmp_path / "a.urdf", ('</link><link name="l0"', visual), ("</robot>", end))
    with pytest.warns(RobosimWarning, match="a.urdf: visual shapes are left out"):
        read(path)


def test_a_number_that_is_none_is_noted_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                             capfd: pytest.CaptureFixture[str]) -> None:
    """MuJoCo would print it itself, and write a file of its own where the command was called."""
    monkeypatch.chdir(tmp_path)
    with pytest.warns(RobosimWarning, match="arm.urdf: XML contains a 'NaN'"):
        draft_arm(write_urdf(tmp_path / "arm.urdf", ('xyz="0 0 0.1" rpy', 'xyz="0 0 nan" rpy')))
    assert capfd.readouterr().err == "" and [path.name for path in tmp_path.iterdir()] == ["arm.urdf"]


def test_prefixes_that_a_file_does_not_declare_are_read(tmp_path: Path) -> None:
    """As those of Drake, which ROS and MuJoCo read, too."""
    path = write_urdf(tmp_path / "a.urdf", (LIMIT % (5, 5), 'drake:acceleration="2.5" ' + LIMIT % (5, 5)),
                      ("</robot>", '<drake:joint name="q"/></robot>'))
    assert read(path).torque.tolist() == read(write_urdf(tmp_path / "b.urdf")).torque.tolist()


@pytest.mark.parametrize(("changes", "message"), [
    ((LIMIT % (5, 5), LIMIT % (5, 5) + '<mimic joint="q2"/>'), "equality 0 of q5 and q2 acts"),
    ((LIMIT % (5, 5), LIMIT % (5, 5) + '<mimic joint="none"/>'), "<mimic> of 'none'; accepted: a joint of q0"),
    (('"q2"', '"q1"'), "joint 'q1' is there twice"), (("3.5", "fast"), "joint q3: velocity = 'fast'"),
    (("</robot>", '<mujoco><compiler settotalmass="20"/></mujoco></robot>'), "settotalmass = 20 would"),
    ((LIMIT % (3, 3), 'effort="3" velocity="3"/>', '"101"', '"0"', '"104"', '"0"', '"2.5"/>', '"0"/>'),
     "no lower_deg of q3; upper_deg of q3; torque of q1, q4; velocity of q2; acc"),
    (('"101"', '"-5"', '"104"', '"inf"', '"2.5"/>', '"1e300"/>'), "no torque of q1, q4; velocity of q2; acc"),
    (("<link name", "<link a & b name"), "cannot be read as a model: it is not XML")])
def test_what_a_urdf_lacks_or_adds_is_named(changes: tuple[str, ...], message: str, tmp_path: Path) -> None:
    """All that is missing at once."""
    with pytest.raises(ConfigError, match=f"a.urdf: .*{message}"):
        read(write_urdf(tmp_path / "a.urdf", *zip(changes[::2], changes[1::2])))


@pytest.mark.parametrize(("place", "added", "message"), [
    ('<joint name="j1"', ' springdamper="0.1 1"', "joint j1 has stiffness"),
    ('<joint name="j1"', ' ref="20"', "j1 has ref"), ('<joint name="j2"', ' axis="1 0 0"/><joint', "several joints"),
    ("</worldbody>", '<tendon><fixed name="belt"><joint joint="j0" coef="1"/></fixed></tendon>', "tendon belt acts"),
    ("</worldbody>", '<equality><connect name="pin" body1="l3" anchor="0 0 0"/></equality>', "equality pin acts"),
    ("<actuator>", '<motor name="jet" site="tip" gear="1 0 0 0 0 0"/>', "actuator jet acts"),
    ("</worldbody>", '<equality><joint name="own" joint1="f"/></equality>', "has no velocity")])
def test_what_moves_joints_beside_their_motors_is_named(place: str, added: str, message: str, tmp_path: Path) -> None:
    """In the compiled model; those of a finger alone are its own."""
    path = write_arm(tmp_path / "arm.xml", 6)
    path.write_text(path.read_text().replace(place, place + added, 1))
    with pytest.raises(ConfigError, match=message):
        read(path, flange="tip")


def test_a_new_arms_file_says_what_to_fill_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All at once; it stands beside the URDF, is the arm when that is done, and is not replaced."""
    path = write_urdf(tmp_path / "Lab 1.urdf", ('"101"', '"0"'), ('"2.5"/>', '"0"/>'), ('"4.5"/>', '"0"/>'))
    assert main(["new", "arm", str(path)]) == 0 and main(["new", "arm", str(path)]) == 2
    file = path.with_suffix(".yaml")
    out = capsys.readouterr().out
    assert out == (f"flange: tool0, at the end of q0, q1, q2, q3, q4, q5\nto fill in: limits.torque of q1\n"
                   f"to fill in: limits.velocity of q2, q4\n{file}\n")
    with pytest.raises(ConfigError, match="has no torque of q1; velocity of q2, q4; accepted"):
        load_arm(str(file))
    assert "# To fill in: q2, q4; null: as in the model\n  velocity: [0.5, 1.5, null, 3.5" in file.read_text()
    file.write_text(re.sub("(velocity|torque): .*", r"\1: [7, 7, 7, 7, 7, 7]", file.read_text()))
    assert load_arm(str(file)).flange == "tool0" and load_arm(str(file)).torque.tolist() == [7.0] * 6
    whole = write_urdf(tmp_path / "whole.urdf", ('velocity="0.5"', 'velocity="1"'))
    assert main(["new", "arm", str(whole)]) == 0 and "to fill in" not in capsys.readouterr().out
    assert load_arm(str(whole.with_suffix(".yaml"))).velocity.tolist() == [1.0, 1.5, 2.5, 3.5, 4.5, 5.5]


@pytest.mark.parametrize("changes", [
    (), ('"finger"', '"l6"', '"f"', '"gripper"'), ('"finger"', '"l6"', 'axis="1 0 0"', 'type="slide"'),
    ('<body name="finger">', '<body name="l6"><joint/><geom size="0.01"/></body><body name="l7">')])
def test_a_new_arm_ends_before_its_hand(changes: tuple[str, ...], tmp_path: Path) -> None:
    """A hand of one joint, known by its name or its motion; one of two fingers."""
    path = write_arm(tmp_path / "arm.xml", 6)
    for old, new in zip(changes[::2], changes[1::2]):
        path.write_text(path.read_text().replace(old, new))
    table, joints, _ = draft_arm(path)
    assert table["flange"] == "l5" and joints == ("j0", "j1", "j2", "j3", "j4", "j5")


def test_what_a_new_arm_cannot_be_made_of_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A package's folder is answered with its models; a note is one line, too."""
    visual = f'<visual><geometry>{BOX}</geometry></visual></link><link name="l0"'
    path = write_urdf(tmp_path / "lab" / "urdf" / "a.urdf", ('</link><link name="l0"', visual))
    assert main(["new", "arm", str(tmp_path / "lab")]) == 2
    assert capsys.readouterr().err == f"robosim new: {tmp_path / 'lab'}: a folder; accepted: a model in it: {path}\n"
    assert main(["rehearse", "spoon", "--set", f"robot={path}", "--out", str(tmp_path / "out")]) == 2
    assert "or the path of a .yaml file of your own, which `robosim new arm MODEL` writes" in capsys.readouterr().err
    assert not list((tmp_path / "lab").rglob("*.yaml"))
    done = subprocess.run([sys.executable, "-m", "robosim", "new", "arm", path], capture_output=True, text=True)
    note = "visual shapes are left out; pictures show those that collide"
    assert done.returncode == 0 and done.stderr == f"robosim new: note: {path}: {note}\n"
    path = write_urdf(tmp_path / "b.urdf", ("collision", "visual"), ('lower="-2.5"', 'lower="-126"'))
    with pytest.warns(RobosimWarning) as notes:
        assert main(["new", "arm", str(path)]) == 0
    assert re.search("no shape of it collides.* ranges beyond two turns: q0 from -126 to 2.5, q1 .*degrees[?]",
                     " ".join(str(one.message) for one in notes))


def test_a_continuous_joint_and_a_motor_say_their_limits(tmp_path: Path) -> None:
    """A turn each way, which is said to be assumed; a motor's force where nothing else limits it. No shape: a note."""
    robot = read(write_urdf(tmp_path / "a.urdf", ('"q3" type="revolute"', '"q3" type="continuous"')))
    assert np.degrees([robot.lower[3], robot.upper[3]]) == pytest.approx([-360, 360]) and robot.home[3] == 0.0
    assert robot.sources["upper_deg"] == "model, assumed a turn each way for continuous joints"
    path = write_arm(tmp_path / "arm.xml", 6, actuator="motor")
    path.write_text(path.read_text().replace("force", "ctrl").replace("<geom ", '<geom contype="0" conaffinity="0" '))
    with pytest.warns(RobosimWarning, match="no shape of it collides"):
        robot = read(path, flange="tip", limits={"velocity": [2.0] * 6})
    assert robot.torque == pytest.approx(2.0 * (20.0 + np.arange(6)))


LINK = """<link name="{}"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0"
iyz="0"/></inertial></link>"""
FINGER = """<joint name="{0}_joint" type="prismatic"><parent link="palm"/><child link="{0}"/><axis xyz="0 {1} 0"/>
<limit lower="0" upper="0.05" effort="40" velocity="1"/>{2}</joint>"""


def test_a_urdf_hand_closes_with_its_mimic_finger(tmp_path: Path) -> None:
    """Its joint is the actuator, its grip a pose in the frame of a link."""
    links = [LINK.format(name) for name in ("palm", "left", "right")]
    fingers = FINGER.format("left", 1, ""), FINGER.format("right", -1, '<mimic joint="left_joint"/>')
    (tmp_path / "hand.urdf").write_text("\n".join(['<robot name="hand">', *links, *fingers, "</robot>"]))
    path = tmp_path / "hand.yaml"
    path.write_text("model: hand.urdf\ngrip: palm\ngrip_pose: {position: [0, 0, 0.1], rotation_deg: [90, 0, 0]}\n"
                    "open: {left_joint: 0.04}\nclosed: {left_joint: 0.01}\n")
    model = compile_spec(assemble("spoon", "ur5e", str(path)).build_spec())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    palm, grip = data.body("hand_palm"), data.site("spoon_grip")
    R = palm.xmat.reshape(3, 3).T
    assert R @ (grip.xpos - palm.xpos) == pytest.approx([0, 0, 0.1], abs=1e-9)
    assert R @ grip.xmat.reshape(3, 3)[:, 1] == pytest.approx([0, 0, 1], abs=1e-9)
    data.ctrl[model.actuator("hand_left_joint").id], model.opt.gravity[:] = 0.04, 0.0
    mujoco.mj_step(model, data, 1000)
    places = [data.joint(f"hand_{side}_joint").qpos[0] for side in ("left", "right")]
    assert places == pytest.approx([0.04, 0.04], abs=1e-3)


def test_an_mjcf_is_read_as_mujoco_reads_it(tmp_path: Path) -> None:
    """Blank lines before its declaration, and &; a tendon within the hand, which the arm's joints move by rounding."""
    path, site = write_arm(tmp_path / "arm.xml", 6), '<site name="{}" pos="{} 0.027 0.041"/>'
    tendon = '<tendon><spatial><site site="palm"/><site site="end"/></spatial></tendon><actuator>'
    finger, text = '<body name="finger">', path.read_text()
    for old, new in (("<mujoco>", "\n <?xml version='1.0'?><mujoco model='a & b'>"), ("<actuator>", tendon),
                     (finger, site.format("palm", 0.7) + finger + site.format("end", 0.1))):
        text = text.replace(old, new)
    path.write_text(text)
    assert read(path, flange="tip", limits={"velocity": [2.0] * 6}).joints[0] == "j0"


def test_a_xacro_file_is_expanded_or_answered_with_how_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_urdf(tmp_path / "a.urdf.xacro", ("</robot>", "<xacro:mine/></robot>"))
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(ConfigError, match=r"a.urdf.xacro: xacro: .*; .*pip install xacro"):
        read(path)
    lacking = SimpleNamespace(process_file=lambda path: import_module("ament_index_python"))
    monkeypatch.setitem(sys.modules, "xacro", lacking)
    with pytest.raises(ConfigError, match="the URDF that `xacro a.urdf.xacro > arm.urdf` writes in a sourced ROS"):
        read(path)
    done = SimpleNamespace(toxml=lambda: path.read_text().replace("<xacro:mine/>", ""))
    monkeypatch.setitem(sys.modules, "xacro", SimpleNamespace(process_file={str(path): done}.__getitem__))
    assert read(path, limits={"velocity": [1.0] * 6}).torque.tolist() == [100.0, 101.0, 102.0, 103.0, 104.0, 105.0]


def test_what_an_arms_file_cannot_say_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_urdf(tmp_path / "a.urdf", ("tool0", 101 * "x"))
    for more, message in (([], "flange: String should have at most 100"), (["--from", "a"], "--from a with a model")):
        assert main(["new", "arm", str(path), *more]) == 2 and message in capsys.readouterr().err
    assert not path.with_suffix(".yaml").exists()
    with pytest.raises(ConfigError, match="servo.stiffness has 5 values; accepted: 6"):
        read(write_urdf(tmp_path / "b.urdf", ('"0.5"', '"1"')), servo={"stiffness": [1] * 5, "damping": [1] * 5})

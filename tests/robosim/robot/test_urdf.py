"""Descriptions as laboratories have them: ROS packages, mimic joints, zeros, hands; read, or refused by name."""

import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
from written_arms import write_urdf

from robosim.base.errors import ConfigError, ModelNote
from robosim.config.arm import ArmConfig
from robosim.robot.assembly import Assembly
from robosim.robot.mjspec import compile_spec
from robosim.robot.robot import load_arm, load_robot_model

BOX = '<box size="0.1 0.1 0.1"/>'
LIMIT = '<limit lower="-2.5" upper="2.5" effort="10{k}" velocity="{k}.5"/>'


def read(path: Path, **more: Any) -> Any:
    return load_robot_model(ArmConfig.model_validate({"model": path.name, "flange": "tool0", **more}), path.parent)


def write_box(path: Path, size: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box([size] * 3).export(path, file_type=path.suffix.lower()[1:])


@pytest.mark.parametrize(("urdf", "package", "address"), [
    ("lab_description/urdf/a.urdf", "lab_description", "package://lab_description/"),
    ("robots/Arm ü.urdf", "lab_description", "package://lab_description/"),
    ("renamed-main/urdf/a.urdf", "renamed-main", "model://lab_description/"),
    ("robots/a.urdf", "elsewhere/lab_description", "package://lab_description/"),
    ("robots/a.urdf", "my folder", "file://{root}/my folder/"), ("robots/a.urdf", "my folder", "../my folder/"),
])
@pytest.mark.parametrize("by_key", [True, False])
def test_meshes_are_found_each_its_own(urdf: str, package: str, address: str, by_key: bool, tmp_path: Path,
                                       monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of one name in two folders, with spaces, upper case and other letters; packages by folder or key."""
    address, root, seen = address.format(root=tmp_path), tmp_path / package, "meshes/Größe 1.STL"
    for folder, size in (("visual", 1.0), ("collision", 0.1), ("more", 0.2)):
        write_box(root / folder / seen, size)
    (root / "package.xml").write_text("<package><name> lab_description </name></package>")
    mesh = f'<mesh filename="{address}%s/{seen}"/></geometry></%s>'
    path = write_urdf(tmp_path / urdf, (f"<collision><geometry>{BOX}</geometry></collision>", "<visual><geometry>"
                      + mesh % ("visual", "visual") + "<collision><geometry>" + mesh % ("collision", "collision")
                      + "<collision><geometry>" + mesh % ("more", "collision")),
                      ("</robot>", '<mujoco><compiler discardvisual="false"/></mujoco></robot>'))
    if by_key:
        (tmp_path / "arm.yaml").write_text(f"model: '{urdf}'\nflange: tool0\npackages: {{lab_description: {package}}}\n"
                                           f"limits: {{velocity: [1, null, null, null, null, null]}}\n")
        monkeypatch.chdir("/")
        robot = load_arm(str(tmp_path / "arm.yaml"))
    else:
        monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(["", str(tmp_path / "elsewhere")]))
        robot = read(path, limits={"velocity": [1, None, None, None, None, None]})
    model = compile_spec(Assembly(robot, None, None).build_spec())
    sizes: dict[int, list[float]] = {0: [], 1: []}
    for g in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        sizes[int(model.geom_contype[g])].append(round(2.0 * float(model.geom_aabb[g, 3]), 6))
    assert sizes == {0: [1.0], 1: [0.1, 0.2]} and robot.velocity.tolist() == [1.0, 1.5, 2.5, 3.5, 4.5, 5.5]


def test_meshes_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    """Refused with address and places; of visual ones there is a note."""
    path = tmp_path / "a.urdf"
    for address, message in (("package://no_such/m.stl", r"a.urdf: mesh package://no_such/m.stl: no folder of package "
                              r"no_such beside or above .*, nor in ROS_PACKAGE_PATH = .* key packages: \{no_such"),
                             ("m.stl", "mesh m.stl: not found as .*m.stl"), ("http://x/m.stl", "mesh http://x/m.stl"),
                             ("own.dae", "link base_link: collision mesh .*own.dae; accepted: .stl, .obj, .msh")):
        (tmp_path / "own.dae").touch()
        write_urdf(path, (BOX, f'<mesh filename="{address}"/>'))
        with pytest.raises(ConfigError, match=message):
            read(path)
    visual = '<visual><geometry><mesh filename="own.dae"/></geometry></visual>'
    for keep, seen in ((), "visual.* are left out"), ((("</robot>", '<mujoco><compiler discardvisual="false"/></mujoco>'
                                                      "</robot>"),), "visual.* are left out"):
        write_urdf(path, ("</link><link", f"{visual}</link><link"), *keep)
        with pytest.warns(ModelNote, match=seen):
            assert read(path, limits={"velocity": [1.0] * 6}).joints[0] == "q0"

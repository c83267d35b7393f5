"""An arm as a laboratory has it: a ROS package with a URDF and meshes."""

from pathlib import Path

import trimesh

LINKS = {"base_link": (0.08, 0.16, 6.0), "shoulder": (0.07, 0.12, 4.0), "upper_arm": (0.05, 0.42, 5.0),
         "forearm": (0.045, 0.36, 3.0), "wrist_1": (0.04, 0.06, 1.0), "wrist_2": (0.04, 0.06, 1.0),
         "wrist_3": (0.035, 0.05, 0.5)}
"""Link -> radius and length [m] of a cylinder from its joint along z, mass [kg]."""
JOINTS = [('revolute', 'z', '<limit lower="-3.1" upper="3.1" effort="120" velocity="3.1"/>'),
          ('revolute', 'y', '<limit lower="-2.3" upper="2.3" effort="120" velocity="2.6"/>'),
          ('revolute', 'y', '<limit lower="-2.6" upper="2.6" effort="80" velocity="3.1"/>'),
          ('continuous', 'z', ''),
          ('revolute', 'y', '<limit lower="-2.1" upper="2.1" effort="20" velocity="3.1"/>'),
          ('revolute', 'z', '<limit lower="-3.1" upper="3.1" effort="0" velocity="4.2"/>')]
"""Type, axis and limits of joint_1 to joint_6: one turns without end and has no limits, one has no effort."""
LINK = """<link name="{0}"><inertial><origin xyz="0 0 {1}"/><mass value="{2}"/>
<inertia ixx="{3}" iyy="{3}" izz="{4}" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://lab_description/meshes/visual/{0}.stl"/></geometry></visual>
<collision><geometry><mesh filename="package://lab_description/meshes/collision/{0}.stl"/></geometry></collision></link>"""
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0 0 {4}"/>{5}</joint>"""


def write_description(root: Path) -> Path:
    """Write the package lab_description into a folder; returns the path of its URDF."""
    package, parts = root / "lab_description", ['<link name="world"/>', '<link name="tool0"/>']
    for folder in ("urdf", "meshes/visual", "meshes/collision"):
        (package / folder).mkdir(parents=True)
    (package / "package.xml").write_text("<package format='2'><name>lab_description</name></package>")
    for name, (radius, length, mass) in LINKS.items():
        for folder, sections in (("visual", 64), ("collision", 16)):
            mesh = trimesh.creation.cylinder(radius, segment=[[0, 0, 0.01], [0, 0, length - 0.01]], sections=sections)
            mesh.export(package / "meshes" / folder / f"{name}.stl")
        across, along = mass * (3.0 * radius**2 + length**2) / 12.0, mass * radius**2 / 2.0
        parts.append(LINK.format(name, length / 2.0, mass, across, along))
    names = ["world", *LINKS, "tool0"]
    ends = [0.0, *(length for _, length, _ in LINKS.values())]
    kinds = [("fixed", "", ""), *JOINTS, ("fixed", "", "")]
    for number, (parent, child, end, (kind, axis, limit)) in enumerate(zip(names, names[1:], ends, kinds)):
        turn = f'<axis xyz="0 {int(axis == "y")} {int(axis == "z")}"/>{limit}' if axis else ""
        parts.append(JOINT.format(f"joint_{number}", kind, parent, child, end, turn))
    path = package / "urdf" / "lab_arm.urdf"
    path.write_text("\n".join(['<robot name="lab_arm">', *parts, "</robot>"]))
    return path

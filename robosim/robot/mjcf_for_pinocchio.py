"""The robot-only MJCF for Pinocchio, written from the compiled model with all digits.

Pinocchio reads only the first body and drops <frame> elements; MuJoCo's own writer rounds to six digits.
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from robosim.scene.models import build_robot_spec, compile_spec


def _format(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in np.atleast_1d(values))


def write_robot_mjcf(tool: str, path: Path) -> None:
    """Write arm, hand and tool without geometry, contact or actuators to a file."""
    model = compile_spec(build_robot_spec(tool))
    root = ET.Element("mujoco", model="robot")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    elements = {0: ET.SubElement(root, "worldbody")}
    for i in range(1, model.nbody):
        body = ET.SubElement(elements[model.body_parentid[i]], "body", name=model.body(i).name,
                             pos=_format(model.body_pos[i]), quat=_format(model.body_quat[i]))
        ET.SubElement(body, "inertial", pos=_format(model.body_ipos[i]), quat=_format(model.body_iquat[i]),
                      mass=_format(model.body_mass[i]), diaginertia=_format(model.body_inertia[i]))
        for j in range(model.body_jntadr[i], model.body_jntadr[i] + model.body_jntnum[i]):
            dof = model.jnt_dofadr[j]
            ET.SubElement(body, "joint", name=model.joint(j).name, type="hinge", pos=_format(model.jnt_pos[j]),
                          axis=_format(model.jnt_axis[j]), range=_format(model.jnt_range[j]),
                          actuatorfrcrange=_format(model.jnt_actfrcrange[j]), armature=_format(model.dof_armature[dof]),
                          damping=_format(model.dof_damping[dof]), frictionloss=_format(model.dof_frictionloss[dof]))
        elements[i] = body
    path.write_text(ET.tostring(root, encoding="unicode"))

"""The arm's kinematics, Jacobian and inverse dynamics, by Pinocchio on the robot-only model.

The model is written from MuJoCo's compiled one with all digits: Pinocchio reads only the first body and drops <frame>
elements, and MuJoCo's own writer rounds to six digits.
"""

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio

from mpm import Pose
from robosim.scene.models import ARM_JOINTS, build_robot_spec, compile_spec

SPEED_LIMITS = np.radians([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0])
"""Joint speed limits [rad/s] (7,), KUKA LBR iiwa 14 R820 data sheet; MJCF has no element for them."""
REACH = 0.820
"""Reach [m] of the wrist centre from the shoulder; same data sheet."""


class Arm:
    """The seven arm joints of the robot with a tool.

    The finger joints stay at their neutral angles. Vectors q, qd and qdd hold angles [rad], speeds [rad/s] and
    accelerations [rad/s^2] of A1..A7, shape (7,).
    """

    def __init__(self, tool: str) -> None:
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "robot.xml"
            write_robot_mjcf(tool, path)
            self.model = pinocchio.buildModelFromMJCF(str(path))
        self.data = self.model.createData()
        joints = [self.model.getJointId(name) for name in ARM_JOINTS]
        self.q_index = np.array([self.model.joints[j].idx_q for j in joints])
        self.v_index = np.array([self.model.joints[j].idx_v for j in joints])
        self.frame = self.model.getFrameId(tool)
        self.lower = self.model.lowerPositionLimit[self.q_index]
        self.upper = self.model.upperPositionLimit[self.q_index]
        self.torque_limits = np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0])
        """[N m] (7,); data sheet, a test compares them with the model."""
        self.neutral = pinocchio.neutral(self.model)
        self._friction = self.model.upperDryFrictionLimit[self.v_index]
        self._damping = self.model.damping[self.v_index]

    def full_configuration(self, q: np.ndarray) -> np.ndarray:
        """Return the configuration of the whole model with the arm at q."""
        whole = self.neutral.copy()
        whole[self.q_index] = q
        return whole

    def tool_placement(self, q: np.ndarray) -> pinocchio.SE3:
        """Return the world pose of the tool's frame, without a copy.

        It is a view of Pinocchio's data, which the next call overwrites.
        """
        pinocchio.forwardKinematics(self.model, self.data, self.full_configuration(q))
        return pinocchio.updateFramePlacement(self.model, self.data, self.frame)

    def tool_pose(self, q: np.ndarray) -> Pose:
        """Return the world pose of the tool's frame."""
        placement = self.tool_placement(q)
        return Pose.from_matrix(placement.translation, placement.rotation)

    def elbow_height(self, q: np.ndarray) -> float:
        """Return the height [m] of the axis of A4."""
        pinocchio.forwardKinematics(self.model, self.data, self.full_configuration(q))
        return float(self.data.oMi[self.model.getJointId("A4")].translation[2])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return the Jacobian (6, 7) of the tool's twist in the tool's own axes.

        Its first three rows are linear.
        """
        whole = self.full_configuration(q)
        J = pinocchio.computeFrameJacobian(self.model, self.data, whole, self.frame, pinocchio.LOCAL)
        return J[:, self.v_index]

    def rigid_torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Compute torques [N m] (7,) on the links' side of the joints.

        Inertia, Coriolis and gravity terms; without armature and joint friction.
        """
        v, a = np.zeros(self.model.nv), np.zeros(self.model.nv)
        v[self.v_index], a[self.v_index] = qd, qdd
        tau = pinocchio.rnea(self.model, self.data, self.full_configuration(q), v, a)[self.v_index]
        return tau - self.model.armature[self.v_index] * qdd

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Compute the motor torques [N m] (7,) of a motion.

        Inertia, armature, Coriolis, gravity, viscous and dry friction terms.
        """
        v, a = np.zeros(self.model.nv), np.zeros(self.model.nv)
        v[self.v_index], a[self.v_index] = qd, qdd
        tau = pinocchio.rnea(self.model, self.data, self.full_configuration(q), v, a)[self.v_index]
        # dry friction changes its sign over 0.01 rad/s, or the command would chatter at rest
        return tau + self._damping * qd + self._friction * np.tanh(qd / 0.01)


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

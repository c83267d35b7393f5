"""The arm as Pinocchio sees it: kinematics, Jacobian and inverse dynamics of the robot-only model."""

import tempfile
from pathlib import Path

import numpy as np
import pinocchio

from mpm import Pose
from robosim.robot.mjcf_for_pinocchio import write_robot_only
from robosim.scene.robot_spec import ARM_JOINTS

SPEED_LIMITS = np.radians([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0])
"""Joint speeds [rad/s] (7,), KUKA LBR iiwa 14 R820 data sheet; the MJCF format has no place for them."""
REACH = 0.820
"""Reach [m] of the wrist centre from the shoulder, same data sheet."""


class Arm:
    """Seven arm joints of the whole robot; the fingers are held at given angles.

    All vectors `q` hold A1..A7 [rad] (7,).
    """

    def __init__(self, tool: str) -> None:
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "robot.xml"
            write_robot_only(tool, path)
            self.model = pinocchio.buildModelFromMJCF(str(path))
        self.data = self.model.createData()
        joints = [self.model.getJointId(name) for name in ARM_JOINTS]
        self.q_index = np.array([self.model.joints[j].idx_q for j in joints])
        self.v_index = np.array([self.model.joints[j].idx_v for j in joints])
        self.frame = self.model.getFrameId(tool)
        self.lower = self.model.lowerPositionLimit[self.q_index]
        self.upper = self.model.upperPositionLimit[self.q_index]
        self.torque_limits = np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0])
        """[N m] (7,), data sheet; a test compares them with the model."""
        self.neutral = pinocchio.neutral(self.model)
        self._friction = self.model.upperDryFrictionLimit[self.v_index]
        self._damping = self.model.damping[self.v_index]

    def full(self, q: np.ndarray) -> np.ndarray:
        """Configuration of the whole model with the arm at q."""
        whole = self.neutral.copy()
        whole[self.q_index] = q
        return whole

    def placement(self, q: np.ndarray) -> pinocchio.SE3:
        """World pose of the tool's frame, as Pinocchio keeps it: it changes with the next call."""
        pinocchio.forwardKinematics(self.model, self.data, self.full(q))
        return pinocchio.updateFramePlacement(self.model, self.data, self.frame)

    def tool_pose(self, q: np.ndarray) -> Pose:
        """World pose of the tool's frame."""
        placement = self.placement(q)
        return Pose.from_matrix(placement.translation, placement.rotation)

    def elbow_height(self, q: np.ndarray) -> float:
        """Height [m] of the axis of A4."""
        pinocchio.forwardKinematics(self.model, self.data, self.full(q))
        return float(self.data.oMi[self.model.getJointId("A4")].translation[2])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Tool twist in the tool's own axes per joint speed (6, 7): linear rows first."""
        whole = pinocchio.computeFrameJacobian(self.model, self.data, self.full(q), self.frame, pinocchio.LOCAL)
        return whole[:, self.v_index]

    def rigid_torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Torques [N m] (7,) on the links' side of the joints for a motion: inertia, Coriolis, gravity."""
        v, a = np.zeros(self.model.nv), np.zeros(self.model.nv)
        v[self.v_index], a[self.v_index] = qd, qdd
        tau = pinocchio.rnea(self.model, self.data, self.full(q), v, a)[self.v_index]
        return tau - self.model.armature[self.v_index] * qdd

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Joint torques [N m] (7,) for a motion: inertia, armature, Coriolis, gravity, viscous and dry friction."""
        v, a = np.zeros(self.model.nv), np.zeros(self.model.nv)
        v[self.v_index], a[self.v_index] = qd, qdd
        tau = pinocchio.rnea(self.model, self.data, self.full(q), v, a)[self.v_index]
        # dry friction flips over 0.01 rad/s, not at once: the command must not chatter where the joint rests
        return tau + self._damping * qd + self._friction * np.tanh(qd / 0.01)

"""The arm's kinematics, Jacobian and inverse dynamics, by Pinocchio on the robot-only model.
The model is written from MuJoCo's compiled one with all digits: Pinocchio reads only the first body and drops <frame>
elements, and MuJoCo's own writer rounds to six digits."""

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio

from mpm import Pose
from robosim.config.arm import ArmServo
from robosim.config.motion import MotionLimitsConfig
from robosim.robot.assembly import Assembly
from robosim.robot.mjspec import compile_spec
from robosim.robot.robot import per_joint

BANDWIDTH, DAMPING_RATIO, MOST_TURNS = 30.0, 1.0, 0.03
"""Of a servo without gains: natural frequency [Hz], damping ratio, and largest natural frequency times step.

With these a step is stable as long as the inertia is above a fifth of the model's, see `Servo.check_step`."""
SLIDE = mujoco.mjtJoint.mjJNT_SLIDE


class MotionLimits(NamedTuple):
    """Largest speed, acceleration and jerk of each joint, each (n,), in SI units."""

    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray


class Gains(NamedTuple):
    """Of the joints' servo, each (n,)."""

    stiffness: np.ndarray
    """[N m/rad]"""
    damping: np.ndarray
    """[N m s/rad]"""
    per_inertia: bool = False
    """Whether they multiply the arm's inertia matrix (computed torque); they are in [1/s^2], [1/s] then."""


class Arm:
    """The n joints of an arm with hand and tool.
    The fingers' joints stay at their neutral angles. Vectors q, qd and qdd hold angles [rad], speeds [rad/s] and
    accelerations [rad/s^2] of the joints from the base to the flange, shape (n,)."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly, robot = assembly, assembly.robot
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "robot.xml"
            compiled = write_robot_mjcf(assembly, path)
            self.model = pinocchio.buildModelFromMJCF(str(path))
        self.data = self.model.createData()
        self.joints, self.home = robot.joints, robot.home
        self._ids = [self.model.getJointId(name) for name in robot.joints]
        self.q_index = np.array([self.model.joints[j].idx_q for j in self._ids])
        self.v_index = np.array([self.model.joints[j].idx_v for j in self._ids])
        frame = robot.flange if assembly.tool is None else assembly.tool.name
        kind = pinocchio.FrameType.OP_FRAME if assembly.tool is None else pinocchio.FrameType.BODY
        self.frame = self.model.getFrameId(frame, kind)
        self.lower, self.upper = robot.lower, robot.upper
        self.velocity, self.torque_limits = robot.velocity, robot.torque
        """[rad/s], [N m] (n,)"""
        self.neutral = pinocchio.neutral(self.model)
        self._whole, self._speed, self._rate = self.neutral.copy(), np.zeros(self.model.nv), np.zeros(self.model.nv)
        """Of all joints, for what is computed many times a step."""
        self._friction = self.model.upperDryFrictionLimit[self.v_index]
        self._damping = self.model.damping[self.v_index]
        dofs = [compiled.joint(name).dofadr[0] for name in robot.joints]
        (d0, d1, *_), period = compiled.dof_solimp[dofs].T, compiled.dof_solref[dofs, 0]
        # MuJoCo's dry friction is soft: full from this speed on. The command would chatter at rest below 0.01 rad/s
        creep = self._friction * compiled.dof_invweight0[dofs] * (1.0 / np.maximum(d0, 1e-4) - 1.0) * d1 * period / 2.0
        self._creep = np.maximum(0.01, creep)

    def step_limits(self) -> MotionLimits:
        """Return the limits of a motion that is commanded step by step."""
        robot = self.assembly.robot
        return MotionLimits(robot.velocity, robot.step_acceleration, robot.step_jerk)

    def limits(self, config: MotionLimitsConfig) -> MotionLimits:
        """Return the limits of a planned motion; raises ConfigError for a wrong number of values."""
        robot = self.assembly.robot
        given = {key: getattr(config, key) for key in ("acceleration", "jerk")}
        values = [getattr(robot, key) if value is None else per_joint(self.joints, value, key, "limits")
                  for key, value in given.items()]
        return MotionLimits(self.velocity * config.velocity_fraction, *values)

    def gains(self, dt: float, config: ArmServo | None = None) -> Gains:
        """Return the servo's gains for a step dt [s], the robot's without a configuration; raises ConfigError."""
        servo = config or self.assembly.robot.servo or ArmServo(damping_ratio=DAMPING_RATIO)
        if servo.stiffness is not None and servo.damping is not None:
            return Gains(per_joint(self.joints, servo.stiffness, "stiffness", "servo"),
                         per_joint(self.joints, servo.damping, "damping", "servo"))
        rate = np.full(len(self.joints), 2.0 * np.pi * (servo.bandwidth or min(BANDWIDTH, MOST_TURNS / dt)))
        return Gains(rate**2, 2.0 * (servo.damping_ratio or DAMPING_RATIO) * rate, per_inertia=True)

    def full_configuration(self, q: np.ndarray) -> np.ndarray:
        """Return the configuration of the whole model with the arm at q."""
        whole = self.neutral.copy()
        whole[self.q_index] = q
        return whole

    def tool_placement(self, q: np.ndarray) -> pinocchio.SE3:
        """Return the world pose of the tool's frame, without a copy: the next call overwrites it."""
        self._whole[self.q_index] = q
        pinocchio.forwardKinematics(self.model, self.data, self._whole)
        return pinocchio.updateFramePlacement(self.model, self.data, self.frame)

    def tool_pose(self, q: np.ndarray) -> Pose:
        """Return the world pose of the tool's frame."""
        placement = self.tool_placement(q)
        return Pose.from_matrix(placement.translation, placement.rotation)

    def margin(self, q: np.ndarray) -> float:
        """Return the smallest distance [rad] of joint angles (..., n) [rad] to their limits."""
        return float(np.minimum(q - self.lower, self.upper - q).min())

    def elbow_height(self, q: np.ndarray) -> float:
        """Return the height [m] of the joint in the middle of the arm above the base."""
        pinocchio.forwardKinematics(self.model, self.data, self.full_configuration(q))
        elbow = self._ids[(len(self._ids) - 1) // 2]
        return float(self.data.oMi[elbow].translation[2] - self.assembly.robot.stand.position[2])

    def distance_beyond_reach(self, point: np.ndarray) -> float:
        """Return how far [m] a point (3,) lies outside the ball about the second joint that holds all tool poses.
        Its radius is the length of the chain from there to the tool's frame with all joints in one line; where it is
        negative the point may still be out of reach."""
        pinocchio.forwardKinematics(self.model, self.data, self.neutral)
        tool = pinocchio.updateFramePlacement(self.model, self.data, self.frame).translation
        places = [*(self.data.oMi[k].translation for k in self._ids[1:]), tool]
        length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
        return float(np.linalg.norm(point - places[0])) - length

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return the Jacobian (6, n) of the tool's twist in the tool's own axes. Its first three rows are linear."""
        whole = self.full_configuration(q)
        J = pinocchio.computeFrameJacobian(self.model, self.data, whole, self.frame, pinocchio.LOCAL)
        return J[:, self.v_index]

    def inertia(self, q: np.ndarray, dt: float = 0.0) -> np.ndarray:
        """Return the joints' inertia matrix (n, n) with armature, and friction over a step as `inverse_dynamics`."""
        whole = pinocchio.crba(self.model, self.data, self.full_configuration(q))  # its upper triangle alone
        M = np.triu(whole[np.ix_(self.v_index, self.v_index)])
        return M + np.triu(M, 1).T + dt * np.diag(self._damping)

    def rigid_torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Compute torques [N m] (n,) on the links' side of the joints, without armature and joint friction."""
        return self._rnea(q, qd, qdd) - self.model.armature[self.v_index] * qdd

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, dt: float = 0.0) -> np.ndarray:
        """Compute the motor torques [N m] (n,) of a motion, with armature, viscous and dry friction.
        dt: step [s] at whose end viscous friction acts, as with MuJoCo's implicitfast."""
        return self._rnea(q, qd, qdd) + self._damping * (qd + dt * qdd) + self._friction * np.tanh(qd / self._creep)

    def most_demanded(self, states: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[float, int, int]:
        """Return the largest share of a motor's torque that states demand, and the numbers of state and joint."""
        shares = np.abs([self.inverse_dynamics(*state) for state in states]) / self.torque_limits
        k, joint = np.unravel_index(np.argmax(shares), shares.shape)
        return float(shares[k, joint]), int(k), int(joint)

    def _rnea(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        self._whole[self.q_index], self._speed[self.v_index], self._rate[self.v_index] = q, qd, qdd
        return pinocchio.rnea(self.model, self.data, self._whole, self._speed, self._rate)[self.v_index]


def _format(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in np.atleast_1d(values))


def write_robot_mjcf(assembly: Assembly, path: Path) -> mujoco.MjModel:
    """Write arm, hand and tool without geometry, contact or actuators to a file; return the compiled model of all."""
    spec = mujoco.MjSpec()
    assembly.attach_to(spec)
    model = compile_spec(spec)
    root = ET.Element("mujoco", model="robot")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    # Pinocchio takes the first body to stand at the origin
    stand = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name="robosim: origin")
    ET.SubElement(stand, "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
    elements = {0: stand}
    for i in range(1, model.nbody):
        body = ET.SubElement(elements[model.body_parentid[i]], "body", name=model.body(i).name or f"body_{i}",
                             pos=_format(model.body_pos[i]), quat=_format(model.body_quat[i]))
        ET.SubElement(body, "inertial", pos=_format(model.body_ipos[i]), quat=_format(model.body_iquat[i]),
                      mass=_format(model.body_mass[i]), diaginertia=_format(model.body_inertia[i]))
        for j in range(model.body_jntadr[i], model.body_jntadr[i] + model.body_jntnum[i]):
            dof = model.jnt_dofadr[j]
            ET.SubElement(body, "joint", name=model.joint(j).name,
                          type="slide" if model.jnt_type[j] == SLIDE else "hinge",
                          pos=_format(model.jnt_pos[j]), axis=_format(model.jnt_axis[j]),
                          range=_format(model.jnt_range[j]), actuatorfrcrange=_format(model.jnt_actfrcrange[j]),
                          armature=_format(model.dof_armature[dof]), damping=_format(model.dof_damping[dof]),
                          frictionloss=_format(model.dof_frictionloss[dof]))
        elements[i] = body
    for i in range(model.nsite):
        if model.site(i).name == assembly.robot.flange:
            ET.SubElement(elements[model.site_bodyid[i]], "site", name=assembly.robot.flange,
                          pos=_format(model.site_pos[i]), quat=_format(model.site_quat[i]))
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return model

"""Arm, hand and tool put together, as the kinematics and the scene read them."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.base.errors import ConfigError
from robosim.config.tool import HEAD
from robosim.robot.hand import NONE, Hand
from robosim.robot.mjspec import BARE, assembling, compile_spec, find_site_pose
from robosim.robot.robot import Robot

HAND_PREFIX = "hand_"
"""Before all names of a hand, which may be those of the arm's maker."""
WRIST_SITE = "wrist_sensor"
"""Site at the flange, in whose axes the wrist sensor measures."""
CLAMP_RADIUS = 0.017
"""[m]"""
CLAMP_MASS = 0.15
"""[kg]"""
GRIP_TURNS_DEG = (0.0, 20.0, -20.0, 40.0, -40.0, 60.0, -60.0, 90.0, -90.0, 120.0, -120.0, 150.0, -150.0, 180.0)
"""Turns of the tool about its handle in the hand that are tried, in this order."""
APPROACH_TO_GRIP = Rotation.from_euler("x", 90.0, degrees=True)
"""Axes of the grip of a bolted tool in those of the flange, as in the bundled hands: y is the flange's z."""


@dataclass(frozen=True)
class ToolModel:
    """A tool's rigid model."""

    name: str
    """Of its body."""
    spec: mujoco.MjSpec
    grip: str
    """Site that a hand holds: z along the handle towards the head, y along the hand's approach."""


@dataclass(frozen=True)
class Assembly:
    """Arm, hand and tool. Names of the hand begin with HAND_PREFIX."""

    robot: Robot
    hand: Hand | None
    """None: the tool is bolted to the flange."""
    tool: ToolModel | None
    """None: the hand is empty."""
    grip_turn_deg: float = 0.0
    """Turn of the tool about its handle in the hand [deg]."""

    @property
    def wrist(self) -> str:
        """Name of the body at the flange, with which all hangs that the wrist carries."""
        if self.hand is not None:
            return HAND_PREFIX + self.hand.base
        return f"{HAND_PREFIX}clamp"

    @property
    def gripper_name(self) -> str:
        """Name of the hand, or none."""
        return NONE if self.hand is None else self.hand.name

    def build_spec(self) -> mujoco.MjSpec:
        """Build the specification of arm, hand and tool alone, whose root is the arm's base at the world's origin."""
        arm = self.robot.spec.copy()
        meet_heads(arm)
        with assembling():
            hand = make_clamp(self.robot.standoff) if self.hand is None else self.hand.spec.copy()
            arm.attach(hand, site=arm.site(self.robot.flange), prefix=HAND_PREFIX)
            if self.tool is not None:
                turn = Rotation.from_euler("z", self.grip_turn_deg, degrees=True).as_quat(scalar_first=True)
                T_wg = self._find_grip() @ Pose(np.zeros(3), turn)
                T_wt = T_wg @ find_site_pose(self.tool.spec, self.tool.grip, self.tool.name).inverse()
                frame = arm.body(self.wrist).add_frame(pos=T_wt.position, quat=T_wt.quaternion)
                frame.attach_body(self.tool.spec.copy().body(self.tool.name), "", "")
        return arm

    def attach_to(self, spec: mujoco.MjSpec) -> None:
        """Put the assembly into a scene, where the arm's base stands."""
        stand, own = self.robot.stand, self.build_spec()
        with assembling():
            frame = spec.worldbody.add_frame(pos=stand.position, quat=stand.quaternion)
            frame.attach_body(own.body(self.robot.base), "", "")

    def _find_grip(self) -> Pose:
        """Pose of the grip in the frame of the wrist's body."""
        if self.hand is not None:
            return find_site_pose(self.hand.spec, self.hand.grip, self.hand.base)
        return Pose(np.array([0.0, 0.0, self.robot.standoff]), APPROACH_TO_GRIP.as_quat(scalar_first=True))


def make_clamp(length: float) -> mujoco.MjSpec:
    """Make a post of a length [m] whose end holds a handle."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="clamp")
    for group, collides in ((2, 0), (3, 1)):
        body.add_geom(name="clamp_post" if collides else "", type=mujoco.mjtGeom.mjGEOM_CYLINDER, group=group,
                      size=[CLAMP_RADIUS, length / 2.0, 0.0], pos=[0.0, 0.0, length / 2.0],
                      mass=0.0 if collides else CLAMP_MASS, contype=collides, conaffinity=collides,
                      rgba=[0.72, 0.73, 0.75, 1.0])
    return spec


def meet_heads(spec: mujoco.MjSpec) -> None:
    """Let all colliding geoms of a specification meet the heads of tools."""
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.conaffinity |= HEAD


def check_payload(assembly: Assembly) -> None:
    """Raise ConfigError where hand and tool alone are heavier than what the arm may carry."""
    payload, model = assembly.robot.payload, compile_spec(assembly.build_spec())
    mass = float(model.body_subtreemass[model.body(assembly.wrist).id])
    if payload is not None and mass > payload:
        raise ConfigError(f"{assembly.gripper_name} with {assembly.tool.name if assembly.tool else 'no tool'} weighs "
                          f"{mass:.3g} kg; accepted: up to the payload of {assembly.robot.name}, {payload:g} kg")


def add_sensors(spec: mujoco.MjSpec, assembly: Assembly) -> None:
    """Add sensors of force and torque between flange and hand, in the axes of WRIST_SITE, and of torque to each joint.
    Those of joints measure beyond motor, rotor and bearing friction; of slides they measure the force."""
    force, torque, site = (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE, mujoco.mjtObj.mjOBJ_SITE)
    spec.body(assembly.wrist).add_site(BARE.default, name=WRIST_SITE, group=4)
    for name, kind in (("wrist_force", force), ("wrist_torque", torque)):
        spec.add_sensor(name=name, type=kind, objtype=site, objname=WRIST_SITE)
    for name in assembly.robot.joints:
        joint, place = spec.joint(name), f"{name}_torque_site"
        joint.parent.add_site(BARE.default, name=place, pos=joint.pos, group=4)
        spec.add_sensor(name=f"{name}_torque", type=force if name in assembly.robot.slides else torque, objtype=site,
                        objname=place)

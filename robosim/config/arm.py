"""Configuration of arm and hand: where their models are, and what the models do not say."""

from typing import Annotated, Literal

from pydantic import Field

from robosim.config.bounds import FilePath, JointValue, Mass, Name, Text
from robosim.config.table import Placement, Table

Grip = Literal["weld", "friction"]
"""How a hand holds a tool."""
LEAST_JOINTS, MOST_JOINTS = 5, 8
OfJoints = Field(min_length=LEAST_JOINTS, max_length=MOST_JOINTS)
PerJoint = Annotated[tuple[JointValue, ...], OfJoints]
"""A value for each joint, from the base to the flange."""
Limits = Annotated[tuple[JointValue | None, ...], OfJoints]
"""As PerJoint; null: as of the model."""
JointPlace = Annotated[float, Field(ge=-720.0, le=720.0)]
"""[deg], or [mm] of a joint that slides."""
Packages = Annotated[dict[Name, FilePath], Field(max_length=32)]
Command = Annotated[float, Field(ge=-1e4, le=1e4)]
"""Of an actuator, in its own unit."""
Commands = Annotated[dict[Name, Command], Field(min_length=1, max_length=32)]


class ArmLimits(Table):
    """Limits of the joints; those that the model has hold where a key is missing, or null in a list."""

    velocity: Limits | None = None
    """[rad/s], [m/s]"""
    acceleration: Limits | None = None
    """[rad/s^2], [m/s^2]"""
    jerk: Limits | None = None
    """[rad/s^3], [m/s^3]"""
    torque: Limits | None = None
    """[N m], [N]"""
    lower_deg: Annotated[tuple[JointPlace | None, ...], OfJoints] | None = None
    upper_deg: Annotated[tuple[JointPlace | None, ...], OfJoints] | None = None


class StepwiseLimits(Table):
    """Limits of a motion that is commanded step by step, as an agent does in an environment."""

    acceleration: PerJoint | None = None
    """Largest acceleration of each joint [rad/s^2], [m/s^2]; null: as of the arm's `limits`."""
    jerk: PerJoint | None = None
    """Largest jerk of each joint [rad/s^3], [m/s^3]; null: as of the arm's `limits`."""


class ArmServo(Table):
    """Servo of the joints: gains of each, or a bandwidth with which they follow from the arm's inertia matrix."""

    stiffness: PerJoint | None = None
    """[N m/rad]; null: from the bandwidth."""
    damping: PerJoint | None = None
    """[N m s/rad]"""
    bandwidth: Annotated[float, Field(ge=0.1, le=1000.0)] | None = None
    """Natural frequency [Hz] of a joint's error; null: 30, or 0.03 / host_dt where that is lower."""
    damping_ratio: Annotated[float, Field(ge=0.05, le=10.0)] | None = None
    """Of a joint's error, to its bandwidth; null: 1, no overshoot."""

    def check(self) -> None:
        given = [key for key in type(self).model_fields if getattr(self, key) is not None]
        if given not in (["stiffness", "damping"], ["bandwidth"], ["damping_ratio"], ["bandwidth", "damping_ratio"]):
            raise ValueError(f"{' with '.join(given) or 'no key'}; accepted: stiffness with damping, or bandwidth, "
                             f"damping_ratio or both")


class ArmConfig(Table):
    """An arm. A missing limit is taken from the model, and an error where the model has none."""

    description: Text = ""
    model: FilePath
    """MJCF or URDF: a path, relative to the file that it stands in; NAME_description of the package robot_descriptions;
    or menagerie:FOLDER of a local MuJoCo Menagerie."""
    flange: Name
    """Site or body at which a hand is mounted; its z is the approach direction."""
    gripper: FilePath = "none"
    """Its usual hand, where a rehearsal names none: of models/grippers, a .yaml file, or none."""
    standoff: Annotated[float, Field(ge=0.02, le=1.0)] = 0.15
    """Distance [m] from the flange to the grip of a tool that is bolted to it without a hand: the clamp's length."""
    mount_turn_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    """Turn of the hand, or of the bolted tool, about the flange's z."""
    base: Placement = Placement()
    """Where the arm's base stands in the world."""
    packages: Packages | None = None
    """ROS package -> its folder, for meshes with package:// in a URDF that are neither beside nor above it."""
    home_deg: Annotated[tuple[JointPlace, ...], OfJoints] | None = None
    """Posture with which the search for postures begins; the middle of the ranges otherwise."""
    payload: Mass | None = None
    """Largest mass of hand, tool and load [kg]."""
    limits: ArmLimits = ArmLimits()
    stepwise: StepwiseLimits = StepwiseLimits()
    servo: ArmServo | None = None
    """null: by the default bandwidth and damping ratio."""


class GripperConfig(Table):
    """A hand. Actuators without a command keep zero."""

    description: Text = ""
    model: FilePath
    """MJCF or URDF, as of an arm."""
    packages: Packages | None = None
    """As of an arm."""
    grip: Name
    """Site or link in the middle of a closed grasp: z along the handle to the tool's head, y along the approach."""
    grip_pose: Placement = Placement()
    """Of the grip in the frame of that site or link."""
    open: Commands
    """Actuator, or joint of a URDF -> command with which the hand is open; a joint's is a place [rad], [m]."""
    closed: Commands
    """Actuator or joint -> command that presses on a handle, with up to the joint's effort."""
    squeeze: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """Largest command beyond the fingers' present place, as a share of the way from open to closed; for actuators
    whose limits allow too much force. null: the actuators' limits are the bound."""

    def check(self) -> None:
        if set(self.open) != set(self.closed):
            raise ValueError(f"open has commands for {', '.join(sorted(self.open))}, closed for "
                             f"{', '.join(sorted(self.closed))}; accepted: the same actuators")

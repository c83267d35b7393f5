"""Configuration of an arm: where its model is, and what the model does not say."""

from typing import Annotated

from pydantic import Field

from robosim.config.bounds import FilePath, JointValue, Mass, Name, Text
from robosim.config.table import Table, Vector3

LEAST_JOINTS, MOST_JOINTS = 5, 8
PerJoint = Annotated[tuple[JointValue, ...], Field(min_length=LEAST_JOINTS, max_length=MOST_JOINTS)]
"""A value for each joint, from the base to the flange."""
Angles = Annotated[tuple[Annotated[float, Field(ge=-720.0, le=720.0)], ...],
                   Field(min_length=LEAST_JOINTS, max_length=MOST_JOINTS)]
"""[deg], or [mm] of a joint that slides."""


class ArmLimits(Table):
    """Limits of the joints; those that the model has hold where a key is missing."""

    velocity: PerJoint | None = None
    """[rad/s], [m/s]"""
    acceleration: PerJoint | None = None
    """[rad/s^2], [m/s^2]"""
    jerk: PerJoint | None = None
    """[rad/s^3], [m/s^3]"""
    torque: PerJoint | None = None
    """[N m], [N]"""
    lower_deg: Angles | None = None
    upper_deg: Angles | None = None


class ArmServo(Table):
    """Impedance servo of the joints."""

    stiffness: PerJoint
    """[N m/rad]"""
    damping: PerJoint
    """[N m s/rad]"""


class BasePose(Table):
    """Where the arm's base stands."""

    position: Vector3 = (0.0, 0.0, 0.0)
    """[m]"""
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    """About x, then y, then z of the world."""


class ArmConfig(Table):
    """An arm. A missing limit is taken from the model, and an error where the model has none."""

    description: Text = ""
    model: FilePath
    """MJCF or URDF; a path is relative to the file that it stands in."""
    flange: Name
    """Site or body at which a hand is mounted; its z is the approach direction."""
    base: BasePose = BasePose()
    home_deg: Angles | None = None
    """Posture with which the search for postures begins; the middle of the ranges otherwise."""
    payload: Mass | None = None
    """Largest mass of hand, tool and load [kg]."""
    limits: ArmLimits = ArmLimits()
    servo: ArmServo | None = None
    """Gains; the default follows from the limits, see `robosim.robot.robot`."""
    reach: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Of the wrist from the base [m]; for messages."""


"""A hand as a value: model, grip, and the commands that open and close it."""

from dataclasses import dataclass
from pathlib import Path

import mujoco

from robosim.base.errors import ConfigError, UnknownName
from robosim.base.resources import part_path
from robosim.config.arm import GripperConfig
from robosim.config.table import Placement, load
from robosim.robot.mjspec import BARE, locate_model, read_model
from robosim.robot.robot import place_site

NONE = "none"
"""Name of no hand: the tool is bolted to the flange."""


@dataclass(frozen=True)
class Hand:
    """A hand that holds a tool's handle."""

    name: str
    spec: mujoco.MjSpec
    """Of the hand alone, without keyframes."""
    base: str
    """Root body; its frame is mounted at the flange."""
    grip: str
    """Site in the middle of a closed grasp."""
    open: dict[str, float]
    """Actuator -> command."""
    closed: dict[str, float]
    squeeze: float | None
    """Largest command beyond the fingers' present place, as a share of the way from open to closed."""


def load_hand(name: str) -> Hand | None:
    """Load a hand by name or from a .yaml file; None for "none"; raises ConfigError, UnknownName."""
    if name == NONE:
        return None
    path = part_path("grippers", name, "gripper", NONE)
    return load_hand_model(load(path, GripperConfig), path.parent)


def load_hand_model(config: GripperConfig, place: Path) -> Hand:
    """Read a hand's model; place: folder of the file with relative paths. Raises ConfigError, UnknownName.
    A joint without an actuator, as of a URDF, gets a position servo that presses with the joint's effort."""
    path = locate_model(config.model, place)
    spec = read_model(path, config.packages)
    roots = [body.name for body in spec.worldbody.bodies]
    if len(roots) != 1 or not roots[0]:
        raise ConfigError(f"{path}: root bodies {', '.join(map(repr, roots)) or 'none'}; accepted: one, with a name")
    if config.grip_pose != Placement() or config.grip not in [site.name for site in spec.sites]:
        place_site(spec, config.grip, config.grip_pose.pose, f"{path}: grip")
    actuators = [actuator.name for actuator in spec.actuators if actuator.name]
    joints = {joint.name: joint for joint in spec.joints if joint.name}
    for name, command in config.open.items():
        if name in actuators:
            continue
        if name not in joints:
            raise UnknownName(f"{path}: open, closed: actuator", name, [*actuators, *joints])
        effort, way = joints[name].actfrcrange[1], abs(command - config.closed[name])
        if min(effort, way) <= 0.0:
            raise ConfigError(f"{path}: joint {name} goes {way:g} with effort {effort:g}; accepted: both above 0")
        servo = spec.add_actuator(BARE.default, name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=effort / (0.1 * way), dampratio=1.0)
        servo.forcelimited, servo.forcerange = True, [-effort, effort]
    return Hand(path.stem, spec, roots[0], config.grip, dict(config.open), dict(config.closed), config.squeeze)

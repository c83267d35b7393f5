"""An arm as a value: model, joints from base to flange, limits and gains, each with its source.

Any MJCF or URDF of a serial arm of 5 to 8 joints serves. What the model says is not asked for again; what neither the
model nor the configuration says is an error, or an assumption that is named in `Robot.sources`.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.input_files import read_text
from robosim.config.arm import LEAST_JOINTS, MOST_JOINTS, ArmConfig, BasePose
from robosim.config.table import load
from robosim.robot.mjspec import bundled_parts, find_part, locate_model, read_model

TO_FULL_SPEED, TO_FULL_ACCELERATION = 0.125, 0.02
"""Times [s] in which a joint is assumed to reach its largest speed, and its largest acceleration."""
STIFFNESS, DAMPING = 30.0, 0.02
"""Assumed stiffness per torque limit [1/rad], and damping per stiffness [s]: about those of the iiwa's controller."""
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
CONFIGURED, ASSUMED = "configuration", "assumed"
FILES = "robots/*/arm.yaml"
"""Of the bundled arms, below models/."""


@dataclass(frozen=True)
class Robot:
    """A serial arm. Vectors have a value for each joint (n,), in SI units."""

    name: str
    spec: mujoco.MjSpec
    """Of the arm alone, with a torque motor for each joint that is named like it, and without keyframes."""
    base: str
    """Root body."""
    stand: Pose
    """Where the base stands in the world."""
    flange: str
    """Site at which a hand is mounted; its z is the approach direction."""
    joints: tuple[str, ...]
    """From the base to the flange."""
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    torque: np.ndarray
    step_acceleration: np.ndarray
    """Of a motion that is commanded step by step."""
    step_jerk: np.ndarray
    home: np.ndarray
    """Posture with which the search for postures begins."""
    stiffness: np.ndarray
    damping: np.ndarray
    payload: float | None
    """[kg]"""
    gripper: str
    """Its usual hand."""
    standoff: float
    """Distance [m] from the flange to the grip of a tool without a hand."""
    sources: dict[str, str]
    """Quantity -> where its values come from."""
    touching: tuple[tuple[str, ...], ...] = ()
    """Pairs of its bodies that touch at home, and make no contacts in any posture."""
    slides: tuple[str, ...] = ()
    """Joints that slide: their values are in metres and newtons."""


def bundled_arms() -> list[str]:
    """Return the names of the arms in models/robots."""
    return bundled_parts(FILES)


def load_arm(name: str) -> Robot:
    """Load an arm by name (models/robots) or from a .yaml file of one's own; raises ConfigError, UnknownName."""
    path = find_part("robot", name, FILES)
    return load_robot_model(load(path, ArmConfig), path.parent)


def load_robot_model(config: ArmConfig, place: Path) -> Robot:
    """Read an arm's model and complete it with its configuration; place: folder of the file with relative paths.

    Raises ConfigError, UnknownName for a model that cannot be read, without the flange, that is no serial arm of 5 to
    8 joints, or whose limits nothing says.
    """
    path = locate_model(config.model, place)
    spec = read_model(path)
    flange, bodies = find_flange(spec, config.flange, path)
    place_flange(spec, bodies[-1], flange, config.mount_turn_deg)
    joints = [joint for body in bodies for joint in body.joints]
    check_chain(bodies, joints, path)
    name_joints(joints)
    names = tuple(joint.name for joint in joints)
    model = spec.copy().compile()
    limits, sources = collect_limits(model, names, config, path)
    write_limits(spec, joints, limits)
    replace_actuators(spec, names, limits["torque"])
    middle = (limits["lower"] + limits["upper"]) / 2.0
    home = middle if config.home_deg is None else to_si(joints, config.home_deg, "home_deg", path)
    if np.any(home < limits["lower"]) or np.any(home > limits["upper"]):
        k = int(np.argmax(np.maximum(limits["lower"] - home, home - limits["upper"])))
        raise ConfigError(f"{path}: home_deg: joint {names[k]} = {home[k]:.4g}; accepted: {limits['lower'][k]:.4g} to "
                          f"{limits['upper'][k]:.4g}")
    touching = exclude_contacts(spec, bodies, names, home)
    servo = config.servo
    sources["servo"] = ASSUMED if servo is None else CONFIGURED
    stiffness = STIFFNESS * limits["torque"] if servo is None else per_joint(names, servo.stiffness, "stiffness", path)
    damping = DAMPING * stiffness if servo is None else per_joint(names, servo.damping, "damping", path)
    return Robot(name=path.stem, spec=spec, base=bodies[0].name, stand=read_stand(config.base), flange=flange,
                 joints=names, home=home, gripper=locate_hand(config.gripper, place), standoff=config.standoff,
                 stiffness=stiffness, damping=damping, payload=config.payload, sources=sources, touching=touching,
                 slides=tuple(joint.name for joint in joints if joint.type == SLIDE), **limits)


def read_stand(base: BasePose) -> Pose:
    """Return the world pose of an arm's base."""
    turn = Rotation.from_euler("xyz", base.rotation_deg, degrees=True)
    return Pose(np.array(base.position), turn.as_quat(scalar_first=True))


def find_flange(spec: mujoco.MjSpec, name: str, path: Path) -> tuple[str, list[Any]]:
    """Return the flange's site, made at a body of that name if there is none, and its bodies from the base on."""
    site = next((site for site in spec.sites if site.name == name), None)
    body = site.parent if site is not None else next((b for b in spec.bodies if b.name == name), None)
    if body is None:
        names = [*(f"site {s.name}" for s in spec.sites if s.name),
                 *(f"body {b.name}" for b in spec.bodies if b.name and b.name != "world")]
        raise UnknownName(f"{path}: flange", name, names)
    if site is None:
        body.add_site(name=name, group=4)
    chain = []
    while body.parent is not None and body.name != "world":
        chain.append(body)
        body = body.parent
    return name, chain[::-1]


def place_flange(spec: mujoco.MjSpec, body: Any, name: str, angle_deg: float) -> None:
    """Replace the flange's site by one of its body itself, turned about its z, however the file places it."""
    site = spec.copy().compile().site(name)
    turn = Rotation.from_quat(site.quat, scalar_first=True) * Rotation.from_euler("z", angle_deg, True)
    spec.delete(spec.site(name))
    body.add_site(name=name, pos=site.pos, quat=turn.as_quat(scalar_first=True), group=4)


def exclude_contacts(spec: mujoco.MjSpec, bodies: list[Any], names: tuple[str, ...],
                     home: np.ndarray) -> tuple[tuple[str, ...], ...]:
    """Exclude contacts that no posture can avoid: of the base with the first link, and of what touches at home.

    Returns the pairs of the latter. MuJoCo leaves contacts of parent and child out, but not those of a static parent.
    """
    moving = next(body for body in bodies if body.joints)
    for static in bodies[: bodies.index(moving)]:
        spec.add_exclude(bodyname1=static.name, bodyname2=moving.name)
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    data.qpos[[model.joint(name).qposadr[0] for name in names]] = home
    mujoco.mj_forward(model, data)
    bodies_of = [[model.body(int(model.geom_bodyid[geom])).name for geom in contact.geom] for contact in data.contact]
    pairs = {tuple(sorted(names)) for names in bodies_of}
    own = {body.name for body in spec.bodies}
    touching = tuple(sorted(pair for pair in pairs if set(pair) <= own - {"world"}))
    for first, second in touching:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    return touching


def write_limits(spec: mujoco.MjSpec, joints: list[Any], limits: dict[str, np.ndarray]) -> None:
    """Give the model the ranges and torques that planner and servo keep to."""
    for joint, lower, upper, most in zip(joints, limits["lower"], limits["upper"], limits["torque"]):
        unit = np.degrees(1.0) if spec.compiler.degree and joint.type == HINGE else 1.0
        joint.range, joint.limited = [lower * unit, upper * unit], True
        joint.actfrcrange, joint.actfrclimited = [-most, most], True


def locate_hand(name: str, place: Path) -> str:
    """Return the name of a hand, or its file's path, which is relative to a folder."""
    return str((place / name).resolve()) if name.endswith((".yaml", ".yml")) else name


def check_chain(bodies: list[Any], joints: list[Any], path: Path) -> None:
    """Raise ConfigError unless joints are those of a serial arm, as Pinocchio has them."""
    double = next((body.name for body in bodies if len(body.joints) > 1), None)
    if double is not None:
        raise ConfigError(f"{path}: body {double} has several joints; accepted: one for each body")
    for joint in joints:
        if joint.ref or joint.stiffness[0]:
            raise ConfigError(f"{path}: joint {joint.name} has ref {joint.ref:g}, stiffness {joint.stiffness[0]:g}; "
                              f"accepted: none of both")
    others = [joint.name or "without a name" for joint in joints if joint.type not in (HINGE, SLIDE)]
    if others:
        raise ConfigError(f"{path}: joint {others[0]} between base and flange has several degrees of freedom; "
                          f"accepted: hinges and slides")
    if not LEAST_JOINTS <= len(joints) <= MOST_JOINTS:
        raise ConfigError(f"{path}: {len(joints)} joints between base and flange ("
                          f"{', '.join(joint.name for joint in joints)}); accepted: {LEAST_JOINTS} to {MOST_JOINTS}")


def name_joints(joints: list[Any]) -> None:
    """Name joints that have no name."""
    for number, joint in enumerate(joints, 1):
        joint.name = joint.name or f"joint_{number}"


def collect_limits(model: mujoco.MjModel, names: tuple[str, ...], config: ArmConfig,
                   path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the limits of joints and the source of each."""
    given, sources = config.limits, {}
    index = [model.joint(name).id for name in names]
    is_limited = model.jnt_limited[index].astype(bool)
    lower, upper = model.jnt_range[index].T
    sources["range"] = "model"
    types = [mujoco.mjtJoint(model.jnt_type[k]) for k in index]
    for end, values in (("lower_deg", given.lower_deg), ("upper_deg", given.upper_deg)):
        if values is not None:
            converted = to_si(types, values, end, path)
            lower, upper = (converted, upper) if end == "lower_deg" else (lower, converted)
            sources["range"] = CONFIGURED
    if not is_limited.all() and (given.lower_deg is None or given.upper_deg is None):
        missing = [name for name, known in zip(names, is_limited) if not known]
        raise ConfigError(f"{path}: joint {missing[0]} has no range; accepted: one in the model, or limits.lower_deg "
                          f"and limits.upper_deg")
    if np.any(lower >= upper):
        k = int(np.argmax(lower >= upper))
        raise ConfigError(f"{path}: joint {names[k]} ranges from {lower[k]:.4g} to {upper[k]:.4g}; accepted: from less "
                          f"to more")
    torque, sources["torque"] = read_torques(model, index), "model"
    if given.torque is not None:
        torque, sources["torque"] = per_joint(names, given.torque, "torque", path), CONFIGURED
    if np.isnan(torque).any():
        raise ConfigError(f"{path}: joint {names[int(np.argmax(np.isnan(torque)))]} has no torque limit; accepted: "
                          f"actuatorfrcrange or an actuator's forcerange in the model, or limits.torque")
    velocity, sources["velocity"] = read_velocities(path, names), "model"
    if given.velocity is not None:
        velocity, sources["velocity"] = per_joint(names, given.velocity, "velocity", path), CONFIGURED
    if velocity is None:
        raise ConfigError(f"{path}: no speed limits, which MJCF has no element for; accepted: limits.velocity, a value "
                          f"for each of {', '.join(names)}")
    acceleration, jerk = velocity / TO_FULL_SPEED, velocity / (TO_FULL_SPEED * TO_FULL_ACCELERATION)
    sources["acceleration"] = sources["jerk"] = ASSUMED
    if given.acceleration is not None:
        acceleration, sources["acceleration"] = per_joint(names, given.acceleration, "acceleration", path), CONFIGURED
        jerk = acceleration / TO_FULL_ACCELERATION
    if given.jerk is not None:
        jerk, sources["jerk"] = per_joint(names, given.jerk, "jerk", path), CONFIGURED
    stepwise = {f"step_{key}": value if own is None else per_joint(names, own, f"stepwise.{key}", path)
                for key, value, own in (("acceleration", acceleration, config.stepwise.acceleration),
                                        ("jerk", jerk, config.stepwise.jerk))}
    return {"lower": lower, "upper": upper, "torque": torque, "velocity": velocity, "acceleration": acceleration,
            "jerk": jerk, **stepwise}, sources


def read_torques(model: mujoco.MjModel, joints: list[int]) -> np.ndarray:
    """Return torque limits (n,), NaN where the model has none: of the joint, or of an actuator that drives it."""
    torque = np.full(len(joints), np.nan)
    for k, joint in enumerate(joints):
        if model.jnt_actfrclimited[joint]:
            torque[k] = np.abs(model.jnt_actfrcrange[joint]).max()
            continue
        for actuator in range(model.nu):
            drives = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT \
                and model.actuator_trnid[actuator, 0] == joint
            if drives and model.actuator_forcelimited[actuator]:
                gear = abs(model.actuator_gear[actuator, 0])
                torque[k] = gear * np.abs(model.actuator_forcerange[actuator]).max()
    return torque


def read_velocities(path: Path, names: tuple[str, ...]) -> np.ndarray | None:
    """Return the speed limits of a URDF; None for a file without them."""
    root = ET.fromstring(read_text(path, 50_000_000))
    found = {joint.get("name"): limit.get("velocity") for joint in root.iter("joint")
             if (limit := joint.find("limit")) is not None and float(limit.get("velocity") or 0.0) > 0.0}
    if not all(name in found for name in names):
        return None
    return np.array([float(found[name] or 0.0) for name in names])


def replace_actuators(spec: mujoco.MjSpec, names: tuple[str, ...], torque: np.ndarray) -> None:
    """Put a torque motor at each joint in the place of the actuators that drive it."""
    for actuator in list(spec.actuators):
        if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and actuator.target in names:
            spec.delete(actuator)
    for name, most in zip(names, torque):
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.ctrllimited = motor.forcelimited = True
        motor.ctrlrange = motor.forcerange = [-most, most]


def per_joint(names: tuple[str, ...], values: tuple[float, ...], key: str, path: Path | str) -> np.ndarray:
    """Return values as an array; raises ConfigError unless there is one for each joint."""
    if len(values) != len(names):
        raise ConfigError(f"{path}: {key} has {len(values)} values; accepted: {len(names)}, for {', '.join(names)}")
    return np.array(values, float)


def to_si(joints: list[Any], values: tuple[float, ...], key: str, path: Path) -> np.ndarray:
    """Return angles in rad, and places of joints that slide in m; joints: of a model, or their types."""
    types = [getattr(joint, "type", joint) for joint in joints]
    if len(values) != len(types):
        raise ConfigError(f"{path}: {key} has {len(values)} values; accepted: {len(types)}, one for each joint")
    return np.array([value * 1e-3 if kind == SLIDE else np.radians(value) for value, kind in zip(values, types)])

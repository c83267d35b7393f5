"""An arm as a value: model, joints from base to flange, limits and gains, each with its source.

Any MJCF or URDF of a serial arm of 5 to 8 joints serves. What the model says is not asked for again; what neither the
model nor the configuration says is an error, or an assumption that is named in `Robot.sources`."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.input_files import read_text
from robosim.base.resources import part_path
from robosim.config.arm import LEAST_JOINTS, MOST_JOINTS, ArmConfig, ArmServo
from robosim.config.table import load
from robosim.robot.mjspec import locate_model, read_model

TO_FULL_SPEED, TO_FULL_ACCELERATION = 0.125, 0.02
"""Times [s] in which a joint is assumed to reach its largest speed, and its largest acceleration."""
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
CONFIGURED, ASSUMED = "configuration", "assumed"


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
    servo: ArmServo | None
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


def load_arm(name: str) -> Robot:
    """Load an arm by name (models/robots) or from a .yaml file of one's own; raises ConfigError, UnknownName."""
    path = part_path("robots", name, "robot")
    return load_robot_model(load(path, ArmConfig), path.parent)


def load_robot_model(config: ArmConfig, place: Path) -> Robot:
    """Read an arm's model and complete it with its configuration; place: folder of the file with relative paths.

    Raises ConfigError, UnknownName for a model that cannot be read, without the flange, that is no serial arm of 5 to
    8 joints, or whose limits nothing says."""
    path = locate_model(config.model, place)
    spec = read_model(path)
    bodies = place_flange(spec, config.flange, config.mount_turn_deg, path)
    joints = [joint for body in bodies for joint in body.joints]
    check_chain(bodies, joints, path)
    for number, joint in enumerate(joints, 1):
        joint.name = joint.name or f"joint_{number}"
    names = tuple(joint.name for joint in joints)
    model = spec.copy().compile()
    limits, sources = collect_limits(model, names, config, path)
    write_limits(spec, joints, limits)
    types, middle = [joint.type for joint in joints], (limits["lower"] + limits["upper"]) / 2.0
    home = middle if config.home_deg is None else to_si(names, types, config.home_deg, "home_deg", path)
    if np.any(home < limits["lower"]) or np.any(home > limits["upper"]):
        k = int(np.argmax(np.maximum(limits["lower"] - home, home - limits["upper"])))
        raise ConfigError(f"{path}: home_deg: joint {names[k]} = {home[k]:.4g}; accepted: {limits['lower'][k]:.4g} to "
                          f"{limits['upper'][k]:.4g}")
    touching = exclude_contacts(spec, bodies, names, home)
    sources["servo"] = ASSUMED if config.servo is None else CONFIGURED
    gripper = config.gripper  # a file's path is relative to that folder
    if gripper.endswith((".yaml", ".yml")):
        gripper = str((place / gripper).resolve())
    return Robot(name=path.stem, spec=spec, base=bodies[0].name, stand=config.base.pose, flange=config.flange,
                 joints=names, home=home, gripper=gripper, standoff=config.standoff,
                 servo=config.servo, payload=config.payload, sources=sources, touching=touching,
                 slides=tuple(joint.name for joint in joints if joint.type == SLIDE), **limits)


def place_flange(spec: mujoco.MjSpec, name: str, angle_deg: float, path: Path) -> list[Any]:
    """Give a flange a site of its body itself, turned about its z; returns the bodies from the base on to it.

    The flange may be a site, however the file places it, or a body; raises UnknownName for neither."""
    site = next((site for site in spec.sites if site.name == name), None)
    body = site.parent if site is not None else next((b for b in spec.bodies if b.name == name), None)
    if body is None:
        names = [*(f"site {s.name}" for s in spec.sites if s.name),
                 *(f"body {b.name}" for b in spec.bodies if b.name and b.name != "world")]
        raise UnknownName(f"{path}: flange", name, names)
    if site is None:
        body.add_site(name=name, group=4)
    compiled = spec.copy().compile().site(name)
    turn = Rotation.from_quat(compiled.quat, scalar_first=True) * Rotation.from_euler("z", angle_deg, True)
    spec.delete(spec.site(name))
    body.add_site(name=name, pos=compiled.pos, quat=turn.as_quat(scalar_first=True), group=4)
    chain = []
    while body.parent is not None and body.name != "world":
        chain.append(body)
        body = body.parent
    return chain[::-1]


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
    """Give the joints the ranges that planner and servo keep to, and torque motors in the place of their actuators."""
    names = [joint.name for joint in joints]
    for actuator in list(spec.actuators):
        if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and actuator.target in names:
            spec.delete(actuator)
    for joint, lower, upper, most in zip(joints, limits["lower"], limits["upper"], limits["torque"]):
        unit = np.degrees(1.0) if spec.compiler.degree and joint.type == HINGE else 1.0
        joint.range, joint.limited = [lower * unit, upper * unit], True
        joint.actfrcrange, joint.actfrclimited = [-most, most], True
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.ctrllimited = motor.forcelimited = True
        motor.ctrlrange = motor.forcerange = [-most, most]


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


def collect_limits(model: mujoco.MjModel, names: tuple[str, ...], config: ArmConfig,
                   path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the limits of joints and the source of each."""
    given, sources = config.limits, {"range": "model"}
    index = [model.joint(name).id for name in names]
    ends = dict(zip(("lower_deg", "upper_deg"), model.jnt_range[index].T))
    for end in ends:
        if (values := getattr(given, end)) is not None:
            ends[end], sources["range"] = to_si(names, model.jnt_type[index], values, end, path), CONFIGURED
    lower, upper = ends.values()
    if not model.jnt_limited[index].all() and (given.lower_deg is None or given.upper_deg is None):
        missing = [name for name, is_known in zip(names, model.jnt_limited[index]) if not is_known]
        raise ConfigError(f"{path}: joint {missing[0]} has no range; accepted: one in the model, or limits.lower_deg "
                          f"and limits.upper_deg")
    if np.any(lower >= upper):
        k = int(np.argmax(lower >= upper))
        raise ConfigError(f"{path}: joint {names[k]} ranges from {lower[k]:.4g} to {upper[k]:.4g}; accepted: from less "
                          f"to more")

    def choose(key: str, other: Any, source: str) -> Any:
        """The configured values, or those of another source."""
        own = getattr(given, key)
        sources[key] = source if own is None else CONFIGURED
        return other if own is None else per_joint(names, own, key, path)

    torque = choose("torque", read_torques(model, index), "model")
    if np.isnan(torque).any():
        raise ConfigError(f"{path}: joint {names[int(np.argmax(np.isnan(torque)))]} has no torque limit; accepted: "
                          f"actuatorfrcrange or an actuator's forcerange in the model, or limits.torque")
    velocity = choose("velocity", read_velocities(path, names), "model")
    if velocity is None:
        raise ConfigError(f"{path}: no speed limits, which MJCF has no element for; accepted: limits.velocity, a value "
                          f"for each of {', '.join(names)}")
    acceleration = choose("acceleration", velocity / TO_FULL_SPEED, ASSUMED)
    jerk = choose("jerk", velocity / (TO_FULL_SPEED * TO_FULL_ACCELERATION) if given.acceleration is None else
                  acceleration / TO_FULL_ACCELERATION, ASSUMED)
    limits = {"lower": lower, "upper": upper, "torque": torque, "velocity": velocity, "acceleration": acceleration,
              "jerk": jerk}
    for key in ("acceleration", "jerk"):
        own = getattr(config.stepwise, key)
        limits[f"step_{key}"] = limits[key] if own is None else per_joint(names, own, f"stepwise.{key}", path)
    return limits, sources


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


def per_joint(names: tuple[str, ...], values: tuple[float, ...], key: str, path: Path | str) -> np.ndarray:
    """Return values as an array; raises ConfigError unless there is one for each joint."""
    if len(values) != len(names):
        raise ConfigError(f"{path}: {key} has {len(values)} values; accepted: {len(names)}, for {', '.join(names)}")
    return np.array(values, float)


def to_si(names: tuple[str, ...], types: Iterable[int], values: tuple[float, ...], key: str, path: Path) -> np.ndarray:
    """Return angles in rad, and places of joints that slide in m."""
    return np.array([value * 1e-3 if kind == SLIDE else np.radians(value)
                     for value, kind in zip(per_joint(names, values, key, path), types)])

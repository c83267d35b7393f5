"""An arm as a value: model, joints from base to flange, limits and gains, each with its source.
Any MJCF or URDF of a serial arm of 5 to 8 joints serves. What the model says is not asked for again; what neither the
model nor the configuration says is an error, or an assumption that is named in `Robot.sources`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mpm import Pose
from robosim.base.errors import ConfigError, UnknownName, note
from robosim.base.resources import part_path
from robosim.config.arm import LEAST_JOINTS, MOST_JOINTS, ArmConfig, ArmServo
from robosim.config.bounds import JOINT_RANGE
from robosim.config.table import load
from robosim.robot.mjspec import BARE, locate_model, read_model
from robosim.robot.urdf import read_limits

TO_FULL_SPEED, TO_FULL_ACCELERATION = 0.125, 0.02
"""Times [s] in which a joint is assumed to reach its largest speed, and its largest acceleration."""
DRIVES = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
CONFIGURED, ASSUMED = "configuration", "assumed"
LEAST_RATE = 1e-9  # above rounding: a tendon within a hand has some of the arm's joints

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
    spec = read_model(path, config.packages)
    bodies, joints = read_chain(spec, config.flange, config.mount_turn_deg, path)
    names, model = tuple(joint.name for joint in joints), spec.copy().compile()
    limits, sources, missing = collect_limits(model, names, config, path)
    if missing:
        lacking = "; ".join(f"{key} of {', '.join(joints)}" for key, joints in missing.items())
        raise ConfigError(f"{path}: has no {lacking}; accepted: all four of a URDF's <limit>, range and an actuator's "
                          f"forcerange in an MJCF, {JOINT_RANGE[0]:g} to {JOINT_RANGE[1]:g}; or the keys of `limits` "
                          f"in the arm's file")
    write_limits(spec, joints, limits)
    types, middle = [joint.type for joint in joints], (limits["lower"] + limits["upper"]) / 2.0
    home = middle if config.home_deg is None else to_si(names, types, config.home_deg, "home_deg", path)
    for key, gains in config.servo or ():
        if key in ("stiffness", "damping") and gains is not None:
            per_joint(names, gains, f"servo.{key}", path)
    if np.any(home < limits["lower"]) or np.any(home > limits["upper"]):
        k = int(np.argmax(np.maximum(limits["lower"] - home, home - limits["upper"])))
        raise ConfigError(f"{path}: home_deg: joint {names[k]} = {home[k]:.4g}; accepted: {limits['lower'][k]:.4g} to "
                          f"{limits['upper'][k]:.4g}")
    touching = exclude_contacts(spec, bodies, names, home)
    sources["servo"] = ASSUMED if config.servo is None else CONFIGURED
    return Robot(name=path.stem, spec=spec, base=bodies[0].name, stand=config.base.pose, flange=config.flange,
                 joints=names, home=home, gripper=config.gripper, standoff=config.standoff,
                 servo=config.servo, payload=config.payload, sources=sources, touching=touching,
                 slides=tuple(joint.name for joint in joints if joint.type == SLIDE), **limits)


def read_chain(spec: mujoco.MjSpec, flange: str, turn_deg: float, path: Path) -> tuple[list[Any], list[Any]]:
    """Place the flange; returns bodies and joints from the base to it, all with names.
    Raises ConfigError unless they are those of a serial arm, as Pinocchio has them."""
    turn = Pose(np.zeros(3), Rotation.from_euler("z", turn_deg, degrees=True).as_quat(scalar_first=True))
    bodies = place_site(spec, flange, turn, f"{path}: flange")
    joints = [joint for body in bodies for joint in body.joints]
    if double := [body.name for body in bodies if len(body.joints) > 1]:
        raise ConfigError(f"{path}: body {double[0]} has several joints; accepted: one for each body")
    if others := [joint.name or "without a name" for joint in joints if joint.type not in (HINGE, SLIDE)]:
        raise ConfigError(f"{path}: joint {others[0]} between base and flange has several degrees of freedom; "
                          f"accepted: hinges and slides")
    if not LEAST_JOINTS <= len(joints) <= MOST_JOINTS:
        raise ConfigError(f"{path}: {len(joints)} joints between base and flange ("
                          f"{', '.join(joint.name for joint in joints)}); accepted: {LEAST_JOINTS} to {MOST_JOINTS}")
    for number, joint in enumerate(joints, 1):
        joint.name = joint.name or f"joint_{number}"
    model = spec.copy().compile()
    check_couplings(model, [joint.name for joint in joints], path)
    if not np.any(model.geom_contype | model.geom_conaffinity):
        note(f"{path}: no shape of it collides; hand and tool alone keep clear of things")
    return bodies, joints


def place_site(spec: mujoco.MjSpec, name: str, own: Pose, what: str) -> list[Any]:
    """Put a site of a body at a pose in the frame of the site or body of that name; returns the bodies from the base.
    The site may stand in frames of the file; raises UnknownName for a name of neither."""
    site = next((site for site in spec.sites if site.name == name), None)
    body = site.parent if site is not None else next((b for b in spec.bodies if b.name == name), None)
    if body is None:
        raise UnknownName(what, name, {one.name for one in [*spec.sites, *spec.bodies]} - {"", "world"})
    if site is None:
        body.add_site(BARE.default, name=name, group=4)
    compiled = spec.copy().compile().site(name)
    frame, turn = (Rotation.from_quat(quat, scalar_first=True) for quat in (compiled.quat, own.quaternion))
    place, turned = compiled.pos + frame.apply(own.position), (frame * turn).as_quat(scalar_first=True)
    spec.delete(spec.site(name))
    body.add_site(BARE.default, name=name, pos=place, quat=turned, group=4)
    chain = []
    while body.parent is not None and body.name != "world":
        chain.append(body)
        body = body.parent
    return chain[::-1]


def exclude_contacts(spec: mujoco.MjSpec, bodies: list[Any], names: tuple[str, ...],
                     home: np.ndarray) -> tuple[tuple[str, ...], ...]:
    """Exclude contacts that no posture can avoid: of the base with the first link, and of what touches at home.
    Returns the pairs of the latter. MuJoCo excludes contacts of parent and child, but not of a static parent."""
    moving = next(body for body in bodies if body.joints)
    for static in bodies[: bodies.index(moving)]:
        spec.add_exclude(bodyname1=static.name, bodyname2=moving.name)
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    data.qpos[[model.joint(name).qposadr[0] for name in names]] = home
    mujoco.mj_forward(model, data)
    bodies_of = [[model.body(int(model.geom_bodyid[geom])).name for geom in contact.geom] for contact in data.contact]
    own = {body.name for body in spec.bodies} - {"world"}
    touching = tuple(sorted({tuple(sorted(pair)) for pair in bodies_of if set(pair) <= own}))
    for first, second in touching:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    return touching


def write_limits(spec: mujoco.MjSpec, joints: list[Any], limits: dict[str, np.ndarray]) -> None:
    """Give the joints the ranges that planner and servo keep to, and torque motors in the place of their actuators."""
    names = [joint.name for joint in joints]
    for actuator in list(spec.actuators):
        if int(actuator.trntype) in DRIVES and actuator.target in names:
            spec.delete(actuator)
    for joint, lower, upper, most in zip(joints, limits["lower"], limits["upper"], limits["torque"]):
        unit = np.degrees(1.0) if spec.compiler.degree and joint.type == HINGE else 1.0
        joint.range, joint.limited = [lower * unit, upper * unit], True
        joint.actfrcrange, joint.actfrclimited = [-most, most], True
        motor = spec.add_actuator(BARE.default, name=joint.name, target=joint.name,
                                  trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.ctrllimited = motor.forcelimited = True
        motor.ctrlrange = motor.forcerange = [-most, most]


def check_couplings(model: mujoco.MjModel, names: list[str], path: Path) -> None:
    """Raise ConfigError for what else than its motor moves or holds a joint of the arm, by its name in the model.
    Read from the compiled model: MuJoCo makes equalities of <mimic>, and springs of springdamper."""
    data, joints = mujoco.MjData(model), [model.joint(name).id for name in names]
    dofs, places = model.jnt_dofadr[joints], model.jnt_qposadr[joints]
    for values, what in ((model.qpos0[places], "ref"), (model.jnt_stiffness[joints], "stiffness"),
                         (np.abs(model.jnt_stiffnesspoly[joints]).max(1), "stiffness"),
                         (np.abs(model.dof_dampingpoly[dofs]).max(1), "damping that is not linear")):
        if values.any():
            k = int(np.argmax(values != 0.0))
            raise ConfigError(f"{path}: joint {names[k]} has {what} {values[k]:.4g}; accepted: none")
    rng = np.random.default_rng(0)  # no element is at rest by chance
    data.qpos[places] += rng.uniform(0.1, 0.2, len(names))
    data.qvel[dofs] = rng.uniform(0.1, 0.2, len(names))
    mujoco.mj_forward(model, data)
    held = data.efc_id[(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (np.abs(data.efc_vel) > LEAST_RATE)]
    driven = [k for k in np.flatnonzero(np.abs(data.actuator_velocity) > LEAST_RATE)
              if not (model.actuator_trntype[k] in DRIVES and model.actuator_trnid[k, 0] in joints)]
    for kind, part, found in (("tendon", model.tendon, np.flatnonzero(np.abs(data.ten_velocity) > LEAST_RATE)),
                              ("equality", model.eq, held), ("actuator", model.actuator, driven)):
        if len(found):
            raise ConfigError(f"{path}: {kind} {part(int(found[0])).name or found[0]} acts on joints of the arm; "
                              f"accepted: joints without <mimic>, which only their motors move")


def collect_limits(model: mujoco.MjModel, names: tuple[str, ...], config: ArmConfig,
                   path: Path) -> tuple[dict[str, np.ndarray], dict[str, str], dict[str, list[str]]]:
    """Return the limits of joints, NaN where nothing says them, the source of each, and key -> joints without it."""
    given, sources, missing = config.limits, dict[str, str](), dict[str, list[str]]()
    index = [model.joint(name).id for name in names]
    types, (speeds, efforts, continuous) = model.jnt_type[index], read_limits(path)

    def choose(key: str, other: np.ndarray, source: str = "model") -> np.ndarray:
        """The configured values, or those of another source where there are none."""
        own = getattr(given, key)
        sources[key] = source if own is None else CONFIGURED
        own = np.full(len(names), np.nan) if own is None else to_si(names, types, own, key, path) \
            if key.endswith("_deg") else per_joint(names, own, key, path)
        values = np.where(np.isnan(own), other, own)
        if np.isnan(values).any() and source != ASSUMED:
            missing[key] = [name for name, value in zip(names, values) if np.isnan(value)]
        return values

    turns, limited = [name in continuous for name in names], model.jnt_limited[index]
    source = f"model, {ASSUMED} a turn each way for continuous joints" if any(turns) else "model"
    lower, upper = (choose(end, np.where(turns, side, np.where(limited, values, np.nan)), source) for end, side, values
                    in zip(("lower_deg", "upper_deg"), (-2.0 * np.pi, 2.0 * np.pi), model.jnt_range[index].T))
    if np.any(lower >= upper):
        k = int(np.argmax(lower >= upper))
        raise ConfigError(f"{path}: joint {names[k]} ranges from {lower[k]:.4g} to {upper[k]:.4g}; accepted: from less "
                          f"to more")
    said = np.array([[values.get(name, np.nan) for name in names] for values in (efforts, speeds)])
    said[0] = said[0] if efforts else read_torques(model, index)
    said[(said < JOINT_RANGE[0]) | (said > JOINT_RANGE[1])] = np.nan
    torque, velocity = choose("torque", said[0]), choose("velocity", said[1])
    acceleration = choose("acceleration", velocity / TO_FULL_SPEED, ASSUMED)
    jerk = choose("jerk", velocity / (TO_FULL_SPEED * TO_FULL_ACCELERATION) if given.acceleration is None else
                  acceleration / TO_FULL_ACCELERATION, ASSUMED)
    limits = {"lower": lower, "upper": upper, "torque": torque, "velocity": velocity, "acceleration": acceleration,
              "jerk": jerk}
    limits |= {f"step_{key}": limits[key] if (own := getattr(config.stepwise, key)) is None else
               per_joint(names, own, f"stepwise.{key}", path) for key in ("acceleration", "jerk")}
    return limits, sources, missing


def read_torques(model: mujoco.MjModel, joints: list[int]) -> np.ndarray:
    """Return torque limits (n,), NaN where the model has none: of the joint, or of an actuator that drives it.
    An actuator without a forcerange whose control is a force, a motor, has that of its ctrlrange."""
    torque = np.full(len(joints), np.nan)
    for k, joint in enumerate(joints):
        if model.jnt_actfrclimited[joint]:
            torque[k] = np.abs(model.jnt_actfrcrange[joint]).max()
            continue
        for a in np.flatnonzero(np.isin(model.actuator_trntype, DRIVES) & (model.actuator_trnid[:, 0] == joint)):
            gear, is_motor = abs(model.actuator_gear[a, 0]), model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED \
                and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
            if model.actuator_forcelimited[a]:
                torque[k] = gear * np.abs(model.actuator_forcerange[a]).max()
            elif is_motor and model.actuator_ctrllimited[a]:
                torque[k] = gear * np.abs(model.actuator_gainprm[a, 0] * model.actuator_ctrlrange[a]).max()
    return torque


def per_joint(names: tuple[str, ...], values: tuple[float, ...], key: str, path: Path | str) -> np.ndarray:
    """Return values as an array; raises ConfigError unless there is one for each joint."""
    if len(values) != len(names):
        raise ConfigError(f"{path}: {key} has {len(values)} values; accepted: {len(names)}, for {', '.join(names)}")
    return np.array(values, float)


def to_si(names: tuple[str, ...], types: Sequence[int], values: tuple[float, ...], key: str, path: Path) -> np.ndarray:
    """Return angles in rad, and places of joints that slide in m."""
    return per_joint(names, values, key, path) * np.where(np.equal(types, SLIDE), 1e-3, np.pi / 180.0)

"""The rigid scene: work cell, arm, hand, tool and containers, assembled from models/."""

import contextlib
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from mpm import Pose
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.resources import folder
from robosim.config.robot import Grip
from robosim.config.scene import ContainerConfig
from robosim.errors import ConfigError
from robosim.scene.frames import container_pose
from robosim.scene.grasp import make_loose

ARM_JOINTS = tuple(f"A{i}" for i in range(1, 8))


def load_spec(*parts: str) -> mujoco.MjSpec:
    """Specification of a file below models/."""
    path = folder("models").joinpath(*parts)
    if not path.is_file():
        raise ConfigError(f"model file {path} is missing; the installation is incomplete")
    return mujoco.MjSpec.from_file(str(path))


@contextlib.contextmanager
def quiet_prefixes() -> Iterator[None]:
    """Attach with empty prefixes on purpose: every name of models/ is unique, and readings use them plainly."""
    mujoco.set_mju_user_warning(lambda text: None)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*prefix.*")
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(None)


def robot_spec(tool: str | None) -> mujoco.MjSpec:
    """Arm, hand and the tool fixed in the hand where the fingers close round its handle; None: no tool."""
    arm = load_spec("robots", "iiwa14", "iiwa14.xml")
    hand = load_spec("grippers", "robotiq_3f", "robotiq_3f.xml")
    T_grip = _site_in_body(hand, "grip", "palm")
    with quiet_prefixes():
        arm.attach(hand, site=arm.site("flange"), prefix="")
        if tool is not None:
            part = load_spec("tools", tool, f"{tool}.xml")
            X = T_grip @ _site_in_body(part, f"{tool}_grip", tool).inverse()
            frame = arm.body("palm").add_frame(pos=X.position, quat=X.quaternion)
            frame.attach_body(part.body(tool), "", "")
    return arm


def _site_in_body(spec: mujoco.MjSpec, site: str, body: str) -> Pose:
    """Pose of a site in a body's frame, from the compiled zero posture."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    T_ws = Pose.from_matrix(data.site(site).xpos, data.site(site).xmat.reshape(3, 3))
    return Pose(data.body(body).xpos.copy(), data.body(body).xquat.copy()).inverse() @ T_ws


class Scene(NamedTuple):
    """A compiled scene and the indices that its users read it by."""

    model: mujoco.MjModel
    arm_qpos: np.ndarray
    """Places of A1..A7 in qpos (7,)."""
    arm_dofs: np.ndarray
    """Places of A1..A7 in qvel (7,)."""
    arm_actuators: np.ndarray
    tool: int
    """Body of the tool."""


def rehearsal_spec(config: RehearsalConfig) -> mujoco.MjSpec:
    """Specification of a rehearsal's whole rigid scene, with its sensors."""
    spec = scene_spec(config.tool, config.grasp, config.containers, config.host_dt,
                      contact="contact" in config.tool_container)
    add_wrist_sensor(spec)
    add_torque_sensors(spec)
    return spec


def scene_spec(tool: str, grasp: Grip, containers: dict[str, ContainerConfig], host_dt: float, *,
               contact: bool) -> mujoco.MjSpec:
    """Work cell, robot with its tool, and containers by the names of their models; contact: of tool and containers."""
    spec = load_spec("workcell", "workcell.xml")
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    robot = robot_spec(tool)
    with quiet_prefixes():
        spec.worldbody.add_frame().attach_body(robot.body("link0"), "", "")
        if grasp == "friction":
            make_loose(spec, tool)
        for name, container in containers.items():
            add_container(spec, name, container)
            if not contact:
                spec.add_exclude(name=f"{tool}_{name}", bodyname1=tool, bodyname2=name)
    spec.option.timestep = host_dt
    return spec


def inner_size(container: str) -> np.ndarray:
    """Inside of a container of models/containers (3,) [m], from the box-shaped site that marks it."""
    return 2.0 * np.array(load_spec("containers", f"{container}.xml").site(f"{container}_inside").size)


def add_container(spec: mujoco.MjSpec, name: str, container: ContainerConfig) -> None:
    """Stand a container of models/containers on its place."""
    pose = container_pose(container)
    frame = spec.worldbody.add_frame(pos=pose.position, quat=pose.quaternion)
    frame.attach_body(load_spec("containers", f"{name}.xml").body(name), "", "")


def add_wrist_sensor(spec: mujoco.MjSpec) -> None:
    """Force and torque between the arm's flange and the hand, in the axes of a site at the flange."""
    spec.body("palm").add_site(name="wrist_sensor", group=4)
    kinds = {"wrist_force": mujoco.mjtSensor.mjSENS_FORCE, "wrist_torque": mujoco.mjtSensor.mjSENS_TORQUE}
    for name, kind in kinds.items():
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="wrist_sensor")


def add_torque_sensors(spec: mujoco.MjSpec) -> None:
    """A torque sensor in each joint, on the link's side of motor, rotor and bearing friction."""
    for name in ARM_JOINTS:
        body = spec.joint(name).parent
        body.add_site(name=f"{name}_torque_site", pos=spec.joint(name).pos, group=4)
        spec.add_sensor(name=f"{name}_torque", type=mujoco.mjtSensor.mjSENS_TORQUE, objtype=mujoco.mjtObj.mjOBJ_SITE,
                        objname=f"{name}_torque_site")


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of a specification, without MuJoCo's warning about empty prefixes."""
    with quiet_prefixes():
        return spec.compile()


def compile_scene(spec: mujoco.MjSpec, tool: str) -> Scene:
    """Compile and look the indices up."""
    model = compiled(spec)
    joints = [model.joint(name) for name in ARM_JOINTS]
    return Scene(
        model,
        np.array([j.qposadr[0] for j in joints]), np.array([j.dofadr[0] for j in joints]),
        np.array([model.actuator(name).id for name in ARM_JOINTS]),
        model.body(tool).id,
    )

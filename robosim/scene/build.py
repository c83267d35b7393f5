"""The rigid scene: work cell, robot with its tool, and containers, assembled and compiled."""

from typing import NamedTuple

import mujoco
import numpy as np

from robosim.config.rehearsal import RehearsalConfig
from robosim.config.robot import Grip
from robosim.config.scene import ContainerConfig
from robosim.scene.frames import container_pose
from robosim.scene.grasp import release_tool_joints
from robosim.scene.models import (
    ARM_JOINTS,
    add_torque_sensors,
    add_wrist_sensor,
    allow_empty_prefixes,
    build_robot_spec,
    compile_spec,
    load_spec,
)


class Scene(NamedTuple):
    """A compiled scene with the indices of its arm and tool."""

    model: mujoco.MjModel
    arm_qpos: np.ndarray
    """Indices of A1..A7 in qpos (7,)."""
    arm_dofs: np.ndarray
    """Indices of A1..A7 in qvel (7,)."""
    arm_actuators: np.ndarray
    """Indices of the motors of A1..A7 in ctrl (7,)."""
    tool: int
    """Index of the tool's body."""


def build_rehearsal_spec(config: RehearsalConfig) -> mujoco.MjSpec:
    """Assemble the whole rigid scene of a rehearsal, with its sensors."""
    spec = build_scene_spec(config.tool, config.grasp, config.containers, config.host_dt,
                            contact="contact" in config.tool_container)
    add_wrist_sensor(spec)
    add_torque_sensors(spec)
    return spec


def build_scene_spec(tool: str, grasp: Grip, containers: dict[str, ContainerConfig], host_dt: float, *,
                     contact: bool) -> mujoco.MjSpec:
    """Assemble work cell, robot with its tool, and containers.

    containers: name in models/containers -> where it stands. host_dt: MuJoCo's time step [s]. contact: whether MuJoCo
    makes contacts between tool and containers.
    """
    spec = load_spec("workcell", "workcell.xml")
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    robot = build_robot_spec(tool)
    with allow_empty_prefixes():
        spec.worldbody.add_frame().attach_body(robot.body("link0"), "", "")
        if grasp == "friction":
            release_tool_joints(spec, tool)
        for name, container in containers.items():
            add_container(spec, name, container)
            if not contact:
                spec.add_exclude(name=f"{tool}_{name}", bodyname1=tool, bodyname2=name)
    spec.option.timestep = host_dt
    return spec


def add_container(spec: mujoco.MjSpec, name: str, container: ContainerConfig) -> None:
    """Add a container of models/containers at its configured pose."""
    pose = container_pose(container)
    frame = spec.worldbody.add_frame(pos=pose.position, quat=pose.quaternion)
    frame.attach_body(load_spec("containers", f"{name}.xml").body(name), "", "")


def compile_scene(spec: mujoco.MjSpec, tool: str) -> Scene:
    """Compile a scene and look up the indices of arm and tool."""
    model = compile_spec(spec)
    joints = [model.joint(name) for name in ARM_JOINTS]
    return Scene(
        model,
        np.array([j.qposadr[0] for j in joints]), np.array([j.dofadr[0] for j in joints]),
        np.array([model.actuator(name).id for name in ARM_JOINTS]),
        model.body(tool).id,
    )

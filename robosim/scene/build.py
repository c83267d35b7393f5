"""The rigid scene: work cell, robot with its tool, and containers, assembled and compiled."""

from pathlib import Path

import mujoco

from mpm import Pose
from robosim.config.arm import Grip
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.scene import ContainerConfig
from robosim.robot.assembly import Assembly, add_sensors, meet_heads
from robosim.robot.mjspec import BARE, assembling, read_model
from robosim.scene.compiled import Scene, compile_scene
from robosim.scene.grasp import release_tool_joints
from robosim.scene.models import assemble, load_container, load_spec

OBSTACLE = (0.80, 0.45, 0.20, 1.0)
"""Colour of obstacles: RGBA."""


def assemble_rehearsal(config: RehearsalConfig) -> Assembly:
    """Put together the arm, hand and tool of a rehearsal; raises ConfigError.
    The tool is not turned in the hand where the file leaves that to the planner."""
    return assemble(config.tool, config.robot, config.gripper, config.grip_turn_deg or 0.0, config.base)


def compile_rehearsal(config: RehearsalConfig, assembly: Assembly | None = None) -> Scene:
    """Assemble and compile the whole rigid scene of a rehearsal; assembly: of its robot, if that exists."""
    assembly = assembly or assemble_rehearsal(config)
    return compile_scene(build_rehearsal_spec(config, assembly), assembly)


def build_rehearsal_spec(config: RehearsalConfig, assembly: Assembly) -> mujoco.MjSpec:
    """Assemble the whole rigid scene of a rehearsal, with its sensors; assembly: of its robot."""
    spec = build_scene_spec(assembly, config.grasp, config.containers, config.host_dt, stand=config.standing_pose,
                            contact="contact" in config.tool_container, workcell=read_workcell(config))
    add_sensors(spec, assembly)
    return spec


def read_workcell(config: RehearsalConfig) -> mujoco.MjSpec:
    """Read the work cell of a rehearsal, with its obstacles; raises ConfigError."""
    own = config.workcell
    spec = load_spec("workcell", "workcell.xml") if own is None else read_model(Path(own))
    for obstacle in config.obstacles:
        body = spec.worldbody.add_body(name=obstacle.name, pos=obstacle.pose.position, quat=obstacle.pose.quaternion)
        radius, _, height = obstacle.half
        kind = mujoco.mjtGeom.mjGEOM_CYLINDER if obstacle.round else mujoco.mjtGeom.mjGEOM_BOX
        body.add_geom(BARE.default, name=obstacle.name, type=kind, rgba=OBSTACLE,
                      size=(radius, height, 0.0) if obstacle.round else obstacle.half)
    return spec


def build_scene_spec(assembly: Assembly, grasp: Grip, containers: dict[str, ContainerConfig], host_dt: float, *,
                     contact: bool, workcell: mujoco.MjSpec | None = None, stand: Pose | None = None) -> mujoco.MjSpec:
    """Assemble work cell, robot with its tool, and containers.
    host_dt: MuJoCo's time step [s]. contact: whether MuJoCo makes contacts between tool and containers. workcell: None
    for the bundled one. stand: where a tool stands that the hand does not hold yet."""
    spec = load_spec("workcell", "workcell.xml") if workcell is None else workcell
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    meet_heads(spec)
    assembly.attach_to(spec)
    if grasp == "friction":
        release_tool_joints(spec, assembly, stand)
    with assembling():
        for name, container in containers.items():
            add_container(spec, name, container)
            if not contact and assembly.tool is not None:
                tool = assembly.tool.name
                spec.add_exclude(name=f"{tool}_{name}", bodyname1=tool, bodyname2=name)
    spec.option.timestep = host_dt
    return spec


def add_container(spec: mujoco.MjSpec, name: str, container: ContainerConfig) -> None:
    """Add a container at its configured pose."""
    pose = container.pose
    frame = spec.worldbody.add_frame(pos=pose.position, quat=pose.quaternion)
    frame.attach_body(load_container(name, container).body(name), "", "")

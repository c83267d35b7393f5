"""A compiled scene with the places of arm, hand and tool in it."""

from typing import NamedTuple

import mujoco
import numpy as np

from robosim.robot.assembly import Assembly
from robosim.robot.mjspec import body_ids_below, compile_spec


class Scene(NamedTuple):
    """A compiled scene with the indices of its arm and tool."""

    model: mujoco.MjModel
    assembly: Assembly
    arm_qpos: np.ndarray
    """Indices of the arm's joints in qpos (n,)."""
    arm_dofs: np.ndarray
    """Indices of the arm's joints in qvel (n,)."""
    arm_actuators: np.ndarray
    """Indices of the joints' motors in ctrl (n,)."""
    base: int
    """Index of the body of the arm's base."""
    wrist: int
    """Index of the body at the flange."""
    tool: int
    """Index of the tool's body."""

    def robot_bodies(self) -> np.ndarray:
        """Return the indices of all bodies of arm, hand and tool."""
        return body_ids_below(self.model, self.base)

    def wrist_mass(self) -> float:
        """Return the mass [kg] that hangs at the flange: hand and tool, however it is held."""
        return float(self.model.body_subtreemass[self.wrist])


def compile_scene(spec: mujoco.MjSpec, assembly: Assembly) -> Scene:
    """Compile a scene and look up the indices of arm, hand and tool."""
    model, robot = compile_spec(spec), assembly.robot
    joints = [model.joint(name) for name in robot.joints]
    tool = assembly.wrist if assembly.tool is None else assembly.tool.name
    return Scene(
        model, assembly,
        np.array([j.qposadr[0] for j in joints]), np.array([j.dofadr[0] for j in joints]),
        np.array([model.actuator(name).id for name in robot.joints]),
        model.body(robot.base).id, model.body(assembly.wrist).id, model.body(tool).id,
    )

"""Handing the grains in a tool from the end of one sub-task to the start of the next."""

from typing import Any, NamedTuple

import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.config.tool import ToolConfig, name_tool
from robosim.scene.grains import grain_volume
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig

MATRIX_FROM_SIX = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Entry of a symmetric tensor's six numbers (xx, yy, zz, xy, xz, yz) for each entry of its matrix."""


class Load(NamedTuple):
    """Grains at rest in a tool, in the tool's frame."""

    task: str
    """Name of the task that left them."""
    tool: str | ToolConfig
    """The tool that holds them."""
    material: Any
    """Configuration of their material."""
    volume: float
    """Of one grain [m^3]."""
    positions: np.ndarray
    """[m] (n, 3)"""
    strain: np.ndarray | None
    """e = b - I as six numbers (n, 6); None for a law without a strain."""
    memory: dict[str, np.ndarray]
    """Other variables of the law (n, 1): volume ratio less one `j`, volume correction `vc`."""

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.positions)


def take_load(env: Any) -> Load:
    """Take the grains that the tool of a `GrainEnv` holds now; raises ConfigError where it holds none."""
    pose, state = env.solver.collider_pose(TOOL), env.solver.state()
    local = pose.inverse().apply(env.solver.positions())
    held = tool_shape(env.task.tool).interior.holds(local)
    if not held.any():
        raise ConfigError(f"{env.TASK}: the {env.task.tool_name} is empty at the end; nothing to hand over")
    strain = rotate_strain(state["e"][held], pose.matrix.T) if "e" in state else None
    volume = env.world.load.volume if env.world.load else grain_volume(env.task)
    return Load(env.TASK, env.task.tool, env.material, volume, local[held], strain,
                {name: state[name][held] for name in ("j", "vc") if name in state})


def rotate_strain(e: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Rotate symmetric tensors of six numbers (n, 6) by a rotation matrix (3, 3): R e R^T."""
    matrices = R @ e[:, MATRIX_FROM_SIX] @ R.T
    return matrices[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]


def task_with_load(name: str, task: TaskConfig, load: Load) -> TaskConfig:
    """Return the task with as many grains as the load; raises ConfigError for another tool, and for too few grains."""
    if not task.carried or task.tool != load.tool:
        raise ConfigError(f"{name}: begins with {'its own grains' if not task.carried else f'a {task.tool_name}'}; "
                          f"accepted: a sub-task that begins with a full {name_tool(load.tool)}, as {load.task} "
                          f"leaves it")
    if load.count < task.grains.observe_every:
        raise ConfigError(f"{name}: {load.count} grains are handed over; accepted: {task.grains.observe_every} or more")
    return task.model_copy(update={"grains": task.grains.model_copy(update={"count": load.count})})


def load_state(task: TaskConfig, load: Load, solver: mpm.Solver) -> dict[str, np.ndarray]:
    """Return the solver's state with the load at rest in the tool."""
    state = solver.state() | load.memory
    if load.strain is not None:
        state["e"] = rotate_strain(load.strain, task.start.pose.matrix)
    return state

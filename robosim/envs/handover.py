"""What one sub-task leaves in its tool, as the start of the next: the same grains, as they lie, in another field."""

from typing import Any, NamedTuple

import numpy as np

import mpm
from robosim.errors import ConfigError
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig
from robosim.tasks.task_field import grain_volume

PLACES = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Entry of a symmetric tensor's list for each place of its matrix."""


class Load(NamedTuple):
    """Grains that a tool holds at rest, in the tool's frame."""

    task: str
    """Whose end this is."""
    tool: str
    material: Any
    """Their configuration."""
    volume: float
    """Of a grain [m^3]."""
    places: np.ndarray
    """(n, 3) [m]"""
    strains: np.ndarray | None
    """(n, 6) e = b - I, None for a law without."""
    memory: dict[str, np.ndarray]
    """(n, 1) of what else a law remembers: volume ratio less one `j`, volume correction `vc`."""

    @property
    def count(self) -> int:
        """Grains."""
        return len(self.places)


def taken(env: Any) -> Load:
    """What the tool of a `GrainEnv` holds now. Raises ConfigError where it holds nothing."""
    pose, state = env.solver.collider_pose(TOOL), env.solver.state()
    local = pose.inverse().apply(env.solver.positions())
    held = tool_shape(env.task.tool).interior.holds(local)
    if not held.any():
        raise ConfigError(f"{env.TASK}: the {env.task.tool} is empty at the end; nothing to hand over")
    strains = turned(state["e"][held], pose.matrix.T) if "e" in state else None
    volume = env.world.load.volume if env.world.load else grain_volume(env.task)
    return Load(env.TASK, env.task.tool, env.material, volume, local[held], strains,
                {name: state[name][held] for name in ("j", "vc") if name in state})


def turned(e: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Strains (n, 6) in axes that a rotation matrix turns them into."""
    matrices = R @ e[:, PLACES] @ R.T
    return matrices[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]


def loaded(name: str, task: TaskConfig, load: Load) -> TaskConfig:
    """The task with as many grains as the load; raises ConfigError for one whose tool does not begin full."""
    if not task.carried or task.tool != load.tool:
        raise ConfigError(f"{name}: begins with {'its own grains' if not task.carried else f'a {task.tool}'}; "
                          f"accepted: a sub-task that begins with a full {load.tool}, as {load.task} leaves it")
    if load.count < task.grains.observe_every:
        raise ConfigError(f"{name}: {load.count} grains are handed over; accepted: {task.grains.observe_every} or more")
    return task.model_copy(update={"grains": task.grains.model_copy(update={"count": load.count})})


def placed(task: TaskConfig, load: Load) -> np.ndarray:
    """Where the grains are [m] (n, 3) with the tool at the task's own start."""
    return task.start.pose.apply(load.places)


def state_of(task: TaskConfig, load: Load, solver: mpm.Solver) -> dict[str, np.ndarray]:
    """The solver's state with the load at rest in the tool."""
    state = solver.state() | load.memory
    if load.strains is not None:
        state["e"] = turned(load.strains, task.start.pose.matrix)
    return state

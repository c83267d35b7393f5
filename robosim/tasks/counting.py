"""Counting of a task's grains after every step: on target, lost, in the tool, touching it."""

import numpy as np
import trimesh

import mpm
from mpm.geometry.sampled_sdf import Lattice
from robosim.rewards.grains import Distance
from robosim.rewards.term import find_term
from robosim.scene.field import TOOL
from robosim.scene.models import container_shape
from robosim.shapes import tool_shape
from robosim.tasks.task import TaskConfig

WALL_POINTS, WALL_MARGIN = 2000, 0.002
"""Points on the surface of a container, and the distance [m] to the tool at which they count as hit."""
PROBE_SPACING = 0.002
"""Lattice spacing [m] of the signed distance of the whole tool."""


def build_counter(task: TaskConfig, solver: mpm.Solver) -> mpm.RegionCounter:
    """Build the counter of a task's grains in a solver: in the target, out of bounds, in the tool and touching it."""
    ranks = task.grains.elites is not None
    touches = task.container is not None or any(term.reads_contact for term in task.reward.values())
    distance = find_term(task.reward, Distance)
    weights = np.zeros(3) if distance is None else np.array(distance.weights)
    points = container_points(task)
    return mpm.RegionCounter(
        solver, np.arange(task.grains.count) if ranks else observed_grains(task), point=np.array(task.goal),
        weights=weights, region=task.target.region, bounds=task.bounds.region,
        inner=tool_shape(task.tool).interior, index=TOOL, reach=0.5 * task.field.cell if touches else None,
        points=points, probe=None if points is None else whole_tool_sdf(task), margin=WALL_MARGIN,
        per_particle=ranks, latching=observed_grains(task))


def observed_grains(task: TaskConfig) -> np.ndarray:
    """Return the indices (n,) of the grains that an observation holds: every `observe_every`-th."""
    return np.arange(task.grains.observe_every - 1, task.grains.count, task.grains.observe_every)


def container_points(task: TaskConfig) -> np.ndarray | None:
    """Sample the container's surface: points [m] (WALL_POINTS, 3) in the world; None without a container."""
    if task.container is None:
        return None
    container = task.containers[task.container]
    walls = container_shape(task.container, container).walls()
    return container.pose.apply(trimesh.sample.sample_surface(walls, WALL_POINTS, seed=0)[0])


def whole_tool_sdf(task: TaskConfig) -> Lattice:
    """Return the signed distance of the whole tool, handle included, in its own frame."""
    return tool_shape(task.tool).real_distance(PROBE_SPACING)

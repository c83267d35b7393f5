"""Counts of a task's grains after every step: on target, lost, in the tool, touching it.

The only file that knows how the field counts: rewards, observations and environments read `TaskCounts`.
"""

from typing import NamedTuple

import numpy as np
import trimesh

import mpm
from mpm.geometry.sampled_sdf import Lattice
from robosim.scene.frames import container_pose
from robosim.scene.models import container_shape
from robosim.shapes import tool_shape
from robosim.tasks.task import TaskConfig

TOOL = 0
"""Index of the tool's collider."""
WALL_POINTS, WALL_MARGIN = 2000, 0.002
"""Points on the surface of a container, and the distance [m] to the tool at which they count as hit."""
PROBE_SPACING = 0.002
"""Lattice spacing [m] of the signed distance of the whole tool."""

Reading = mpm.Counts
"""What the field returns for a step, before it is translated."""


class TaskCounts(NamedTuple):
    """Counts of one step. Sums and numbers of grains are over the grains that the task counts."""

    distance: float
    """Sum of the weighted Manhattan distances to the goal [m]."""
    newly_lost: int
    """Grains that left the bounds in this step; a grain is lost once and for good."""
    lost_on_target: int
    """Those of them that were on the target one step earlier."""
    on_target: int
    """Grains inside the target region."""
    lost: int
    """Grains that have left the bounds since the episode's start."""
    held: int
    """Grains inside the tool's interior."""
    touching: int
    """Grains, of all, whose centre is within half a cell of the tool's surface; 0 where the task does not ask."""
    wall_hits: int
    """Points on the container that are within `WALL_MARGIN` of the tool; 0 without a container."""
    clearance: float
    """Smallest distance [m] of those points to the tool, at most 1 m."""
    grain_distances: np.ndarray | None = None
    """Distance [m] of each counted grain (n,), float32; None unless the task ranks grains."""
    grain_on_target: np.ndarray | None = None
    """1.0 for each counted grain on the target, else 0.0 (n,), float32; None unless the task ranks grains."""


class TaskCounter:
    """Counts a task's grains in a solver, also within its advances once `attach` has been called."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver) -> None:
        ranks = task.grains.elites is not None
        touches = task.container is not None or task.reward.contact > 0.0
        points = container_points(task)
        self._solver = solver
        self._counter = mpm.RegionCounter(
            solver, np.arange(task.grains.count) if ranks else observed_grains(task), point=np.array(task.goal),
            weights=np.array(task.reward.distance.weights), region=task.target.region, bounds=task.bounds.region,
            inner=tool_shape(task.tool).interior, index=TOOL, reach=0.5 * task.field.cell if touches else None,
            points=points, probe=None if points is None else whole_tool_sdf(task), margin=WALL_MARGIN,
            per_particle=ranks, latching=observed_grains(task))

    def attach(self, sample: mpm.Sample | None) -> None:
        """Have the solver count within its advances and sample the observed grains at their end."""
        self._solver.attach(self._counter, sample)

    def place(self, frame: mpm.Pose) -> None:
        """Move goal, target, bounds and container's points from the task's places by a displacement."""
        self._counter.place(frame)

    def restart(self) -> None:
        """Forget which grains were lost or on target before; the present state is the first."""
        self._counter.restart()

    def read(self) -> TaskCounts:
        """Count the present state."""
        return self.translate(self._counter.read())

    def state(self) -> np.ndarray:
        """Return what each grain is remembered for (n,), int8: that it was lost, that it was on target."""
        return self._counter.state()

    def load(self, state: np.ndarray) -> None:
        """Take over what `state` returned; raises mpm.InvalidValue for another number of grains."""
        self._counter.load(state)

    def translate(self, reading: Reading) -> TaskCounts:
        """Convert a reading of the field, as `Solver.advance` returns it, to the task's counts."""
        ranks = reading.per_particle
        return TaskCounts(*reading[:9], *((ranks[:, 0], ranks[:, 1]) if ranks is not None else (None, None)))


def observed_grains(task: TaskConfig) -> np.ndarray:
    """Return the indices (n,) of the grains that an observation holds: every `observe_every`-th."""
    return np.arange(task.grains.observe_every - 1, task.grains.count, task.grains.observe_every)


def container_points(task: TaskConfig) -> np.ndarray | None:
    """Sample the container's surface: points [m] (WALL_POINTS, 3) in the world; None without a container."""
    points = None
    for name in task.sources:
        container = task.containers[name]
        walls = container_shape(name, container).walls()
        points = container_pose(container).apply(trimesh.sample.sample_surface(walls, WALL_POINTS, seed=0)[0])
    return points


def whole_tool_sdf(task: TaskConfig) -> Lattice:
    """Return the signed distance of the whole tool, handle included, in its own frame."""
    return tool_shape(task.tool).real_distance(PROBE_SPACING)

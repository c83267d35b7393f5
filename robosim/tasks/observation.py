"""Observations of a sub-task: layouts, bounds, and the slice of each part in a flat one."""

from typing import Any, Literal

import gymnasium
import numpy as np

import mpm
from mpm.state.particles import SPEED_LIMIT
from robosim.tasks.counting import observed_grains
from robosim.tasks.sections import LARGEST_DOSE
from robosim.tasks.task import TaskConfig

Layout = Literal["flat", "dict", "moments", "positions", "velocities", "none", "all"]
DOSING_TERMS = ("tool", "goal", "time", "scale", "target")
"""Terms that a dosing task observes where nothing else is chosen; see `robosim.senses.senses.TERMS`."""
SCOOPING_TERMS = ("tool", "goal", "time", "wrist", "height_map", "target")
"""The same without a receiver: no balance shows what the tool holds."""
TOOL_MARGIN = 0.05
"""Distance [m] by which an arm may carry the tool past the box of commanded positions."""

AT_HOME = mpm.Pose.identity()
"""Displacement of places that are where the task has them."""
Bounds = tuple[np.ndarray, np.ndarray]
"""Lowest and highest values, one each per number."""


class Observer:
    """Builds observations of one layout; before the time, those of a dosing task have the mass to dose [kg], "target".

    flat: position and velocity (n, 6) of every `observe_every`-th grain, row by row, then tool pose and time;
    all: the same of every grain; positions, velocities: only these (n, 3); none: no grains;
    dict: "particles" (n, 6), "tool" and "time"; moments: statistics of all grains, whose number of entries does not
    depend on the number of grains.
    """

    def __init__(self, task: TaskConfig, solver: mpm.Solver, layout: Layout) -> None:
        self.task, self.layout = task, layout
        every = np.arange(task.grains.count)
        self.grains = {"none": every[:0], "all": every, "moments": every}.get(layout, observed_grains(task))
        """Indices of the grains that are observed."""
        self._grid = solver.grid
        self._row = grain_bounds(solver.grid, solver.dt)
        self.slices: dict[str, slice] = {}
        """Name of each part of a flat observation -> its slice."""
        self.space = self._build_space()

    def read(self, grains: np.ndarray, pose: mpm.Pose, counts: mpm.Counts, progress: float,
             place: mpm.Pose = AT_HOME, target: float = 0.0) -> Any:
        """Return an observation in an array of its own.

        grains (n, 6): position [m] and velocity [m/s] of the observed grains. pose: of the tool, its quaternion without
        jumps of sign. progress: share of the episode that is over. place: displacement of the task's places. target:
        mass to dose [kg].
        """
        tool = pose.position if self.task.action.dimensions == 3 else np.concatenate(pose)
        dose = [] if self.task.dose is None else [target]
        if self.layout == "dict":
            return {"particles": grains.copy(), "tool": tool.astype(np.float32),
                    **({"target": np.array(dose, np.float32)} if dose else {}),
                    "time": np.array([progress], np.float32)}
        if self.layout == "moments":
            values = moments(self.task, grains, pose, counts, place)
        else:
            values = {"positions": grains[:, :3], "velocities": grains[:, 3:]}.get(self.layout, grains).ravel()
        return np.concatenate([values, tool, dose, [progress]], dtype=np.float32, casting="same_kind")

    def _build_space(self) -> gymnasium.Space:
        """Return the observation space, and note the slices of a flat one."""
        n, (low, high) = len(self.grains), self._row
        columns = {"flat": slice(0, 6), "all": slice(0, 6), "positions": slice(0, 3), "velocities": slice(3, 6)}
        parts: dict[str, Bounds] = {}
        if self.layout in columns:
            chosen = columns[self.layout]
            parts["particles"] = (np.tile(low[chosen], n), np.tile(high[chosen], n))
        if self.layout == "moments":
            parts |= moment_bounds(self.task, self._row)
        parts["tool"] = tool_bounds(self.task, self._grid)
        if self.task.dose is not None:
            parts["target"] = (np.zeros(1), np.full(1, 1e-3 * LARGEST_DOSE))
        parts["time"] = (np.zeros(1), np.ones(1))
        if self.layout == "dict":
            spaces: dict[str, gymnasium.Space[Any]] = {name: _box(*bounds) for name, bounds in parts.items()}
            spaces["particles"] = _box(np.tile(low, (n, 1)), np.tile(high, (n, 1)))
            return gymnasium.spaces.Dict(spaces)
        begin = 0
        for name, (lowest, _) in parts.items():
            self.slices[name] = slice(begin, begin + len(lowest))
            begin += len(lowest)
        return _box(np.concatenate([b[0] for b in parts.values()]), np.concatenate([b[1] for b in parts.values()]))


def moments(task: TaskConfig, grains: np.ndarray, pose: mpm.Pose, counts: mpm.Counts,
            place: mpm.Pose = AT_HOME) -> np.ndarray:
    """Return statistics of all grains, in the order of `moment_bounds`; arguments as of `Observer.read`."""
    x, v = grains[:, :3].astype(float), grains[:, 3:].astype(float)
    n, counted = len(x), task.grains.counted
    candidates = n if task.grains.elites else counted
    centre = x.mean(0)
    covariance = np.cov(x.T)[np.triu_indices(3)]
    parts = [centre, v.mean(0), covariance, np.percentile(x, (5, 95), axis=0).ravel(), v.std(0),
             centre - place.apply(np.array(task.goal)[None])[0],
             pose.inverse().apply(centre[None])[0],
             [counts.in_inner / candidates, counts.in_region / candidates, counts.exited / counted]]
    if task.container is not None:
        parts.append([counts.near / n, min(counts.clearance, 0.1)])
    return np.concatenate(parts)


def moment_bounds(task: TaskConfig, row: Bounds) -> dict[str, Bounds]:
    """Return the parts of `moments` with their bounds; row: those of a grain, from `grain_bounds`."""
    (lower, _), (upper, fastest) = np.split(row[0], 2), np.split(row[1], 2)
    diagonal = np.full(3, np.linalg.norm(upper - lower))
    bounds = {
        "centre": (lower, upper), "velocity": (-fastest, fastest),
        "covariance": (-np.full(6, 1.0), np.full(6, 1.0)), "extent": (np.tile(lower, 2), np.tile(upper, 2)),
        "velocity_spread": (0 * fastest, fastest),
        "from_goal": (lower - task.goal, upper - task.goal), "in_tool_frame": (-diagonal, diagonal),
    }
    bounds |= {name: (np.zeros(1), np.ones(1)) for name in ("held", "on_target", "lost")}
    if task.container is not None:
        bounds |= {"touching": (np.zeros(1), np.ones(1)), "clearance": (-np.full(1, 0.1), np.full(1, 0.1))}
    return bounds


def grain_bounds(grid: mpm.Grid, dt: float) -> Bounds:
    """Return the bounds (6,) of a grain's position [m] and velocity [m/s] with substeps of dt [s]."""
    lower, upper = _box_inside_walls(grid)
    # a grain that is faster counts as diverged
    fastest = np.full(3, SPEED_LIMIT * grid.cell / dt)
    return np.concatenate([lower, -fastest]), np.concatenate([upper, fastest])


def tool_bounds(task: TaskConfig, grid: mpm.Grid) -> Bounds:
    """Return the bounds of the tool's pose (7,), or of its position (3,) [m] where actions are translations."""
    # a tool that is dropped falls to the table, outside the box of commanded positions
    lower, upper = _box_inside_walls(grid)
    low = np.minimum(np.array(task.action.lower) - TOOL_MARGIN, lower - TOOL_MARGIN)
    high = np.maximum(np.array(task.action.upper) + TOOL_MARGIN, upper + TOOL_MARGIN)
    if task.action.dimensions == 6:
        low, high = np.append(low, [-1.01] * 4), np.append(high, [1.01] * 4)
    return low, high


def _box_inside_walls(grid: mpm.Grid) -> Bounds:
    """Return the corners [m] (3,) of the grid's box, widened by the rounding of positions to single precision."""
    return (np.asarray(grid.lower) - 0.01 * grid.cell,
            np.asarray(grid.lower) + (grid.cells + 0.01) * grid.cell)


def _box(low: np.ndarray, high: np.ndarray) -> gymnasium.spaces.Box:
    """Return a space of single-precision numbers between bounds."""
    return gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)

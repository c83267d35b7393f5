"""What a policy observes of a dosing task, and the bounds of grains and tool."""

import numpy as np

import mpm
from robosim.tasks.task import TaskConfig

TOOL_MARGIN = 0.05
"""Distance [m] by which an arm may carry the tool past the box of commanded positions."""
CROSSING_TIME = 2e-4
"""Time [s] in which the fastest grain crosses a cell: 40 m/s with 8 mm, far above what is thrown or falls."""
Bounds = tuple[np.ndarray, np.ndarray]
"""Lowest and highest values, one each per number."""


def dose_terms(task: TaskConfig) -> tuple[str, ...]:
    """Return the terms that a dosing task observes where nothing else is chosen; see `robosim.senses.senses.TERMS`.
    Without a receiver no balance shows what the tool holds."""
    return ("tool", "goal", "time", *(("wrist", "height_map") if task.receiver is None else ("scale",)), "target")


def grain_bounds(grid: mpm.Grid) -> Bounds:
    """Return the bounds (6,) of a grain's position [m] and velocity [m/s]: the same with every material."""
    lower, upper = _box_inside_walls(grid)
    fastest = np.full(3, grid.cell / CROSSING_TIME)
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
    """Corners [m] (3,) of the grid's box, widened by the rounding of positions to single precision."""
    return np.asarray(grid.lower) - 0.01 * grid.cell, np.asarray(grid.lower) + (grid.cells + 0.01) * grid.cell

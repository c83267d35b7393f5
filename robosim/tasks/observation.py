"""What an agent sees of the grains and the tool: layouts, their bounds, and which numbers stand where."""

from typing import Any, Literal

import gymnasium
import numpy as np

import mpm
from mpm.stepping.substep import SPEED_LIMIT
from robosim.tasks.counting import TaskCounts, observed_grains
from robosim.tasks.task import TaskConfig

Layout = Literal["flat", "dict", "moments", "positions", "velocities", "none", "all"]
REACH = 0.05
"""[m] beside the box that the command stays in to which the arm may follow."""


class Observer:
    """Fills observations of one layout.

    flat: positions and velocities (n, 6) of every delta_d-th grain, row by row, then the tool's pose and the time; all:
    likewise of every grain; positions, velocities: only these (n, 3); none: no grains; dict: "particles" (n, 6),
    "tool", "time"; moments: about 40 numbers whose count does not depend on the grains.
    """

    def __init__(self, task: TaskConfig, solver: mpm.Solver, layout: Layout) -> None:
        self.task, self.layout = task, layout
        every = np.arange(task.grains.count)
        self.chosen = {"none": every[:0], "all": every, "moments": every}.get(layout, observed_grains(task))
        """Indices of the grains that are looked at."""
        cell = solver.grid.cell
        # a hair wider than the walls, because positions are rounded to single precision
        lower = np.asarray(solver.grid.lower) - 0.01 * cell
        upper = np.asarray(solver.grid.lower) + (solver.grid.cells + 0.01) * cell
        # a cell in a substep, beyond which a run counts as diverged
        fast = np.full(3, SPEED_LIMIT * cell / solver.dt)
        self._low6, self._high6 = np.concatenate([lower, -fast]), np.concatenate([upper, fast])
        self._lower, self._upper, self._fast = lower, upper, fast
        self.slices: dict[str, slice] = {}
        """Part of a flat observation -> where it stands."""
        self.space = self._space()

    def read(self, grains: np.ndarray, pose: mpm.Pose, now: TaskCounts, progress: float) -> Any:
        """An observation, in an array of its own, of the chosen grains (n, 6), a tool whose quaternion does not jump,
        what was tallied, and the share of the episode that is over."""
        tool = pose.position if self.task.action.dimensions == 3 else np.concatenate(pose)
        if self.layout == "dict":
            return {"particles": grains.copy(), "tool": tool.astype(np.float32),
                    "time": np.array([progress], np.float32)}
        if self.layout == "moments":
            seen = self._moments(grains, pose, now)
        else:
            seen = {"positions": grains[:, :3], "velocities": grains[:, 3:]}.get(self.layout, grains).ravel()
        return np.concatenate([seen, tool, [progress]], dtype=np.float32, casting="same_kind")

    def _moments(self, grains: np.ndarray, pose: mpm.Pose, now: TaskCounts) -> np.ndarray:
        """Numbers of the whole heap; `_moment_bounds` says which."""
        x, v = grains[:, :3].astype(float), grains[:, 3:].astype(float)
        n, counted = len(x), self.task.grains.counted
        looked_at = n if self.task.grains.elites else counted
        middle = x.mean(0)
        spread = np.cov(x.T)[np.triu_indices(3)]
        parts = [middle, v.mean(0), spread, np.percentile(x, (5, 95), axis=0).ravel(), v.std(0),
                 middle - self.task.goal, pose.inverse().apply(middle[None])[0],
                 [now.held / looked_at, now.on_target / looked_at, now.lost / counted]]
        if self.task.kind == "scoop":
            parts.append([now.touching / n, min(now.clearance, 0.1)])
        return np.concatenate(parts)

    def _moment_bounds(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        lower, upper, fast = self._lower, self._upper, self._fast
        wide = upper - lower
        bounds = {
            "centre": (lower, upper), "velocity": (-fast, fast), "covariance": (-np.full(6, 1.0), np.full(6, 1.0)),
            "extent": (np.tile(lower, 2), np.tile(upper, 2)), "velocity_spread": (0 * fast, fast),
            "from_goal": (lower - self.task.goal, upper - self.task.goal),
            "in_tool_frame": (-np.full(3, np.linalg.norm(wide)), np.full(3, np.linalg.norm(wide))),
        }
        bounds |= {name: (np.zeros(1), np.ones(1)) for name in ("held", "on_target", "lost")}
        if self.task.kind == "scoop":
            bounds |= {"touching": (np.zeros(1), np.ones(1)), "clearance": (-np.full(1, 0.1), np.full(1, 0.1))}
        return bounds

    def _space(self) -> gymnasium.Space:
        n = len(self.chosen)
        # a tool that is dropped falls to the table, beside the box that the command stays in
        tool_low = np.minimum(np.array(self.task.action.lower) - REACH, self._lower - REACH)
        tool_high = np.maximum(np.array(self.task.action.upper) + REACH, self._upper + REACH)
        if self.task.action.dimensions == 6:
            tool_low, tool_high = np.append(tool_low, [-1.01] * 4), np.append(tool_high, [1.01] * 4)
        tables = {"flat": (self._low6, self._high6, n), "all": (self._low6, self._high6, n),
                  "positions": (self._low6[:3], self._high6[:3], n),
                  "velocities": (self._low6[3:], self._high6[3:], n)}
        parts: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        if self.layout in tables:
            low, high, rows = tables[self.layout]
            parts["particles"] = (np.tile(low, rows), np.tile(high, rows))
        if self.layout == "moments":
            parts |= self._moment_bounds()
        parts |= {"tool": (tool_low, tool_high), "time": (np.zeros(1), np.ones(1))}
        if self.layout == "dict":
            spaces: dict[str, gymnasium.Space[Any]] = {name: _box(*bounds) for name, bounds in parts.items()}
            spaces["particles"] = _box(np.tile(self._low6, (n, 1)), np.tile(self._high6, (n, 1)))
            return gymnasium.spaces.Dict(spaces)
        begin = 0
        for name, (low, _) in parts.items():
            self.slices[name] = slice(begin, begin + len(low))
            begin += len(low)
        return _box(np.concatenate([b[0] for b in parts.values()]), np.concatenate([b[1] for b in parts.values()]))


def _box(low: np.ndarray, high: np.ndarray) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)

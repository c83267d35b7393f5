"""The privileged terms of grains that are tracked one by one, and of their statistics."""

from typing import Any

import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.senses.term import SenseScene, Sight, Term, box
from robosim.tasks.counting import observed_grains
from robosim.tasks.observation import Bounds, grain_bounds
from robosim.tasks.task import TaskConfig

COLUMNS = {"particles": slice(0, 6), "positions": slice(0, 3), "velocities": slice(3, 6)}
"""Layout -> columns of a grain's row of position and velocity."""
FAR = 10.0
"""Bound [m] of lengths in `GoalFrameTerm`, which holds wherever a target is drawn."""
LAYOUTS = (*COLUMNS, "moments")


class GrainsTerm(Term):
    """Grains of the field, which no sensor sees.

    layout: "particles" (position and velocity), "positions", "velocities" or "moments" (statistics of all grains).
    every: True for all grains; False for those that the task observes."""

    name, unit = "grains", "m, m/s"
    privileged = all_grains = True

    def __init__(self, scene: SenseScene, layout: str = "particles", every: bool = False) -> None:
        if layout not in LAYOUTS:
            raise ConfigError(f"obs: grains: layout = {layout!r}; accepted: {', '.join(LAYOUTS)}")
        self._task, self._layout = scene.task, layout
        row = grain_bounds(scene.solver.grid)
        if layout == "moments":
            bounds = moment_bounds(scene.task, row)
            self.parts = {name: len(low) for name, (low, _) in bounds.items()}
            self.space = box(*(np.concatenate(side) for side in zip(*bounds.values())))
            return
        self._chosen = np.arange(scene.task.grains.count) if every else observed_grains(scene.task)
        low, high = (np.tile(side[COLUMNS[layout]], (len(self._chosen), 1)) for side in row)
        self.space = box(low, high)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return rows of grains (n, 6) or (n, 3), or the moments (m,)."""
        if self._layout == "moments":
            return moments(self._task, sight)
        rows = sight.grains if len(sight.grains) == len(self._chosen) else sight.grains[self._chosen]
        return rows[:, COLUMNS[self._layout]]


GOAL_FRAME = {"tool": 3, "tool_axes": 6, "axes": 2, "centre": 3, "in_tool_frame": 3, "covariance": 6, "extent": 6,
              "velocity": 3, "shares": 3}
"""Parts of `GoalFrameTerm`, with their lengths. axes: x of the frame in the world; shares: held, on target, lost."""


class GoalFrameTerm(Term):
    """Moments of all grains and the tool's pose in the frame of the displaced target, with its goal as the origin.

    Where the target stands does not show, but for the heading of the frame, as actions have the axes of the world."""

    name, unit = "goal_frame", "m, m/s, 1"
    privileged = all_grains = True

    def __init__(self, scene: SenseScene) -> None:
        self._task = scene.task
        limits = {"velocity": grain_bounds(scene.solver.grid)[1][3]}
        limit = np.repeat([limits.get(name, FAR) for name in GOAL_FRAME], list(GOAL_FRAME.values()))
        self.space = box(-limit, limit)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the parts of GOAL_FRAME, one after the other."""
        place, grains = sight.setting.place, sight.grains.astype(float)
        frame = mpm.Pose(place.apply(np.array(self._task.goal)[None])[0], place.quaternion)
        tool, x = frame.inverse() @ sight.believed, frame.inverse().apply(grains[:, :3])
        return np.concatenate([
            tool.position, tool.matrix[:, [0, 2]].T.ravel(), frame.matrix[:2, 0], x.mean(0),
            tool.inverse().apply(x.mean(0)[None])[0], np.cov(x.T)[np.triu_indices(3)],
            np.percentile(x, (5, 95), axis=0).ravel(), grains[:, 3:].mean(0) @ frame.matrix, shares(self._task, sight)])


class ObservedGrains(GrainsTerm):
    """The same of the grains that the task observes, where no other term reads all of them."""

    all_grains = False


def moments(task: TaskConfig, sight: Sight) -> np.ndarray:
    """Return statistics of all grains, in the order of `moment_bounds`."""
    x, v, counts = sight.grains[:, :3].astype(float), sight.grains[:, 3:].astype(float), sight.counts
    centre = x.mean(0)
    covariance = np.cov(x.T)[np.triu_indices(3)]
    parts = [centre, v.mean(0), covariance, np.percentile(x, (5, 95), axis=0).ravel(), v.std(0),
             centre - sight.setting.place.apply(np.array(task.goal)[None])[0],
             sight.pose.inverse().apply(centre[None])[0],
             shares(task, sight)]
    if task.container is not None:
        parts.append([counts.near / len(x), min(counts.clearance, 0.1)])
    return np.concatenate(parts)


def shares(task: TaskConfig, sight: Sight) -> list[float]:
    """Return the shares of the grains that are in the tool, on the target, and lost."""
    counts, counted = sight.counts, task.grains.counted
    candidates = len(sight.grains) if task.grains.elites else counted
    return [counts.in_inner / candidates, counts.in_region / candidates, counts.exited / counted]


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

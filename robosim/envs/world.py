"""What episodes of a sub-task run in: field, counter and observer, and the starts that are drawn for them."""

import itertools
import math
from typing import Any, get_args

import numpy as np

import mpm
from mpm.materials.stable_step import material_bound
from robosim.config.materials import Law, law_of, load_material, overridden
from robosim.envs.handover import Load, loaded, placed, state_of
from robosim.envs.start import settled
from robosim.errors import ConfigError, UnknownName
from robosim.tasks.counting import TOOL, TaskCounter
from robosim.tasks.observation import Layout, Observer
from robosim.tasks.task import TaskConfig, load_task
from robosim.tasks.task_field import build_solver, substep

Ranges = dict[str, tuple[float, float]]


class World:
    """A sub-task with a material; one environment runs in it, or several in turns.

    name: of the file that its settled start is kept in. numbers: of the material, in place of its own. randomize:
    ranges that episodes draw numbers of the material from. mobile: contact moves the tool, too. load: what another
    sub-task has left in the tool, in place of the task's own grains and material.
    """

    def __init__(self, name: str, task: TaskConfig | str, *, material: str | None = None, obs: Layout = "flat",
                 numbers: dict[str, float] | None = None, randomize: Ranges | None = None,
                 mobile: bool = False, load: Load | None = None) -> None:
        if obs not in get_args(Layout):
            raise UnknownName("obs", obs, get_args(Layout))
        self.task = task if isinstance(task, TaskConfig) else load_task(task)
        if load is not None:
            self.task = loaded(name, self.task, load)
        own = load.material if load is not None and material is None else load_material(material or self.task.material)
        self.material = overridden(own, numbers or {}, "option, or number of this material,")
        self.randomize = self._ranges(randomize or {})
        mpm.init()
        self.load, places = load, None if load is None else placed(self.task, load)
        self.solver = build_solver(self.task, law_of(self.material), mobile=mobile, places=places,
                                   volume=None if load is None else load.volume)
        self.counter = TaskCounter(self.task, self.solver)
        self.observer = Observer(self.task, self.solver, obs)
        self.sample = mpm.Sample(self.solver, self.observer.chosen) if len(self.observer.chosen) else None
        self.counter.attach(self.sample)
        if load is None:
            self._state = settled(name, self.task, self.material, self.solver)
        else:
            self._state = state_of(self.task, load, self.solver)
            self.solver.load(self._state)

    def _ranges(self, randomize: Ranges) -> Ranges:
        """The ranges, checked: known numbers, and no pair that the time step cannot follow."""
        for name, given in randomize.items():
            low, high = given if np.ndim(given) == 1 and len(given) == 2 else (math.nan, math.nan)
            if not low <= high:
                raise ConfigError(f"randomize: {name} = {given!r}; accepted: (lowest, highest)")
        dt = substep(self.task, law_of(self.material))
        for corner in itertools.product(*randomize.values()):
            numbers = dict(zip(randomize, corner))
            bound = material_bound(self.task.field.cell, law_of(overridden(self.material, numbers)))
            if dt > bound:
                raise ConfigError(f"randomize: {numbers} needs a time step of {bound:.3g} s; this has {dt:.3g} s: "
                                  f"take a softer or a heavier material")
        return dict(randomize)

    def drawn_law(self, rng: np.random.Generator) -> Law | None:
        """The material of an episode, None: as ever."""
        if not self.randomize:
            return None
        numbers = {name: float(rng.uniform(*pair)) for name, pair in self.randomize.items()}
        return law_of(overridden(self.material, numbers))

    def drawn_start(self, rng: np.random.Generator, *, nominal: bool) -> tuple[mpm.Pose, np.ndarray]:
        """Where the tool begins, and by how much [m] (3,) a pile or container's grains are moved aside."""
        start, action = self.task.start, self.task.action
        if nominal:
            return start.pose, np.zeros(3)
        tool = rng.uniform(-1.0, 1.0, 3) * start.spread
        pile = rng.uniform(-1.0, 1.0, 3) * start.pile_spread
        return mpm.Pose(np.clip(start.position + tool, action.lower, action.upper), start.pose.quaternion), pile

    def placed(self, tool: mpm.Pose, pile: np.ndarray) -> dict[str, np.ndarray]:
        """The settled state with the tool at a pose; grains in it go with it, others by `pile`."""
        state, origin = dict(self._state), self.solver.grid.origin
        if self.task.carried:
            local = self.task.start.pose.inverse().apply(state["x"] + origin)
            state["x"] = tool.apply(local) - origin
        else:
            state["x"] = state["x"] + pile
        state["poses"] = state["poses"].copy()
        state["poses"][TOOL] = np.concatenate(tool)
        return state

    def grains(self) -> np.ndarray:
        """Observed grains (n, 6) of the solver's present state."""
        return self.sample.read() if self.sample is not None else np.zeros((0, 6), np.float32)


def checked_options(options: dict[str, Any] | None) -> bool:
    """Whether options of a reset ask for the nominal start."""
    unknown = set(options or {}) - {"nominal"}
    if unknown:
        raise UnknownName("option of reset", sorted(unknown)[0], ["nominal"])
    return bool((options or {}).get("nominal", False))

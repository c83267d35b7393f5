"""The simulated world of a sub-task: field, counter and observer, and the random starts of episodes."""

import copy
import hashlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.observers.diagnostics import Momentum
from robosim.config.materials import law_of, load_material, overridden
from robosim.config.tool import ToolConfig
from robosim.envs.carrier import Carrier
from robosim.envs.episode import Episode
from robosim.envs.start import StartOptions, rotate_grains, settled_state, turned
from robosim.errors import ConfigError
from robosim.senses.perception import Perception, PerceptionOptions
from robosim.tasks.counting import TOOL, TaskCounter
from robosim.tasks.field import build_solver
from robosim.tasks.handover import Load, load_positions, load_state, task_with_load
from robosim.tasks.randomization import Draw, Randomization, Ranges, Vector
from robosim.tasks.task import TaskConfig, load_task

NO_GRAINS = np.zeros((0, 6), np.float32)
STANDARD = PerceptionOptions()
STATE_FORMAT = 2
"""Raised when a state has other entries."""


class Memory(NamedTuple):
    """What an environment keeps from step to step besides field, episode and carrier."""

    generator: np.random.Generator | None
    """None before the first reset."""
    seed: int | None
    """Of the generator; -1: a generator of the user's own."""
    observation: Any
    """The last one."""
    senses: Any = None
    """What the terms of the observation remember of the episode."""
    waiting: list[Any] = []  # noqa: RUF012  (never changed)
    """Velocities that the robot has yet to carry out."""


class World:
    """A sub-task with a material; one environment runs in it, or a batch of them.

    name: of the file that the settled start is cached in. perception: what is observed; `observer.build` completes it.
    numbers: of the material, in place of its own. randomize: ranges that each episode draws numbers from. mobile:
    contact moves the tool, too. load: what another sub-task has left in the tool, in place of the task's own grains and
    material. tool: in place of the task's.
    Raises ConfigError, UnknownName for options that cannot be used.
    """

    def __init__(self, name: str, task: TaskConfig | str, *, material: str | None = None,
                 perception: PerceptionOptions = STANDARD, numbers: dict[str, float] | None = None,
                 randomize: Ranges | None = None, mobile: bool = False, load: Load | None = None,
                 tool: str | ToolConfig | None = None) -> None:
        self.task = task if isinstance(task, TaskConfig) else load_task(task)
        if tool is not None:
            self.task = self.task.with_tool(tool)
        if load is not None:
            self.task = task_with_load(name, self.task, load)
        own = load.material if load is not None and material is None else load_material(material or self.task.material)
        self.material = overridden(own, numbers or {}, "option, or number of this material,")
        self.randomization = Randomization(self.task, self.material, randomize or {})
        self.observer = Perception(self.task, perception)
        self.load, positions = load, None if load is None else load_positions(self.task, load)
        self.solver = build_solver(self.task, law_of(self.material), mobile=mobile, positions=positions,
                                   volume=None if load is None else load.volume)
        self.counter = TaskCounter(self.task, self.solver)
        self.sample = mpm.Sample(self.solver, self.observer.grains) if len(self.observer.grains) else None
        self.counter.attach(self.sample)
        if load is None:
            self._settled = settled_state(name, self.task, self.material, self.solver)
        else:
            self._settled = load_state(self.task, load, self.solver)
            self.solver.load(self._settled)

    def draw(self, rng: np.random.Generator, options: StartOptions) -> Draw:
        """Draw what is random in an episode, or take what the options give back."""
        if options.draw is not None:
            return self.randomization.read(options.draw)
        return self.randomization.draw(rng, nominal=options.nominal, shift=options.shift, turn_deg=options.turn_deg)

    def tool_pose(self, draw: Draw) -> mpm.Pose:
        """Return the tool's pose at the start of an episode."""
        start, action, tool = self.task.start, self.task.action, np.array(draw.tool)
        position = np.clip(start.position + tool, action.lower, action.upper) if tool.any() else start.pose.position
        return mpm.Pose(position, turned(start.pose.quaternion, draw.turn_deg))

    def start_state(self, tool: mpm.Pose, pile: Vector) -> dict[str, np.ndarray]:
        """Return the settled state with the tool at a pose.

        Grains in the tool move with it; others are displaced by pile [m] (3,).
        """
        state, origin = dict(self._settled), self.solver.grid.origin
        if self.task.carried:
            local = self.task.start.pose.inverse().apply(state["x"] + origin)
            state |= rotate_grains(state, tool.matrix @ self.task.start.pose.matrix.T)
            state["x"] = tool.apply(local) - origin
        else:
            state["x"] = state["x"] + np.array(pile)
        state["poses"] = state["poses"].copy()
        state["poses"][TOOL] = np.concatenate(tool)
        return state

    def grains(self) -> np.ndarray:
        """Return position [m] and velocity [m/s] of the observed grains (n, 6) in the solver's present state."""
        return self.sample.read() if self.sample is not None else NO_GRAINS

    # states ---------------------------------------------------------------------------------------------------------
    def describe(self, **options: Any) -> dict[str, Any]:
        """Return all that a state depends on: task, material, layout, precision, and options of the environment."""
        load, numbers = self.load, self.material.numbers()
        handed = None if load is None else hashlib.sha256(np.ascontiguousarray(load.positions).tobytes()).hexdigest()
        return {
            "format": STATE_FORMAT, **options,
            **{f"task.{name}": value for name, value in self.task.model_dump(mode="json").items()},
            "material": type(self.material).__name__,
            **{f"material.{name}": getattr(self.material, name).value for name in numbers},
            "randomize": {name: [float(value) for value in pair] for name, pair in self.randomization.ranges.items()},
            "obs": self.observer.describe(), "load": None if load is None else f"{load.count} grains, {handed}",
            "precision": self.solver.precision,
        }

    def save(self, options: dict[str, Any], episode: Episode, carrier: Carrier, memory: Memory) -> dict[str, Any]:
        """Return the state of the environment that the solver holds now: arrays and plain values.

        options: what `describe` returned for it.
        """
        solver = self.solver
        generator = None if memory.generator is None else memory.generator.bit_generator.state
        # an arm's ledger begins with the momentum of the grains, summed in the order of the last launch
        momentum = np.array(solver.momentum_after_advance()) if solver.features.mobile else None
        return {
            "options": dict(options), "solver": solver.state(), "material": dict(vars(solver.bodies[0].material)),
            "frictions": [collider.friction for collider in solver.colliders],
            "momentum": momentum, "counter": self.counter.state(), "episode": episode.state(),
            "carrier": carrier.state(), "generator": generator, "seed": memory.seed,
            "observation": copy.deepcopy(memory.observation), "senses": copy.deepcopy(memory.senses),
            "waiting": copy.deepcopy(memory.waiting),
        }

    def restore(self, state: Any, options: dict[str, Any], episode: Episode, carrier: Carrier) -> Memory:
        """Set solver, episode and carrier to a state that `save` returned; return the rest of it.

        Raises ConfigError, and changes nothing, for a state of other options, and for one that lacks something.
        """
        check_options(state, options)
        solver = self.solver
        before = episode.state(), carrier.state(), self.counter.state(), solver.bodies[0].material
        frictions = [collider.friction for collider in solver.colliders]
        try:
            memory = Memory(read_generator(state["generator"]), state["seed"], copy.deepcopy(state["observation"]),
                            copy.deepcopy(state["senses"]), copy.deepcopy(state["waiting"]))
            momentum = None if state["momentum"] is None else Momentum(*np.array(state["momentum"], float))
            episode.load(state["episode"])
            carrier.load(state["carrier"])
            self.counter.load(state["counter"])
            solver.set_material(0, type(before[3])(**state["material"]))
            set_frictions(solver, state["frictions"])
            solver.load(state["solver"])
        except BaseException as error:
            episode.load(before[0])
            carrier.load(before[1])
            self.counter.load(before[2])
            solver.set_material(0, before[3])
            set_frictions(solver, frictions)
            if not isinstance(error, Exception):
                raise
            what = f"it has no {error}" if isinstance(error, KeyError) else error
            raise ConfigError(f"load: the state is incomplete or changed: {what}; accepted: what `state` returned") \
                from error
        if momentum is not None:
            solver.adopt_state(list(solver.paths.poses), solver.time, solver.steps, momentum)
        return memory


def set_frictions(solver: mpm.Solver, frictions: Sequence[float]) -> None:
    """Set the friction of every collider."""
    for index, friction in enumerate(frictions):
        if solver.colliders[index].friction != friction:
            solver.set_friction(index, friction)


def check_options(state: Any, own: dict[str, Any]) -> None:
    """Raise ConfigError for what is no state of an environment, or one of another task or of other options."""
    if not isinstance(state, dict) or not isinstance(state.get("options"), dict):
        raise ConfigError(f"load: {state!r:.60}; accepted: what `state` of an environment returned")
    given = state["options"]
    names = [name for name in own | given if name not in given or name not in own or given[name] != own[name]]
    if names:
        differences = [", ".join(f"{name} = {values.get(name)!r:.60}" for name in names[:3]) for values in (given, own)]
        raise ConfigError(f"load: the state is of an environment with {differences[0]}; accepted: one with "
                          f"{differences[1]}")


def read_generator(state: dict[str, Any] | None) -> np.random.Generator | None:
    """Return a random generator in a state of its `bit_generator`."""
    if state is None:
        return None
    bits = getattr(np.random, state["bit_generator"])(0)
    bits.state = state
    return np.random.Generator(bits)

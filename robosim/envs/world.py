"""The simulated world of a sub-task: field, counter and observer, and the random starts of episodes."""

import copy
import hashlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.observers.diagnostics import Momentum
from robosim.base.errors import ConfigError
from robosim.config.materials import Law, grain_diameter_of, load_material, overridden
from robosim.envs.carrier import Carrier
from robosim.envs.episode import EnvOptions, Episode
from robosim.envs.start import StartOptions, rotate_grains, settled_state, turned
from robosim.randomization.draw import HOME, Draw, Setting
from robosim.randomization.randomization import Randomization
from robosim.randomization.ranges import choose_ranges
from robosim.scene.field import FieldOptions, build_field, build_tool_lattice, check_substeps, largest_step
from robosim.scene.grains import Filling, fill, grain_volume
from robosim.senses.perception import Perception
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL, build_counter
from robosim.tasks.handover import load_positions, load_state, task_with_load
from robosim.tasks.task import TaskConfig, load_task

NO_GRAINS = np.zeros((0, 6), np.float32)
DEFAULT_OPTIONS = EnvOptions()
STATE_FORMAT = 5
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


class Setters(NamedTuple):
    """What sets the numbers of one environment's field."""

    material: Callable[[Law], None]
    """The law of the grains."""
    volume: Callable[[float], None]
    """Of a grain [m^3]."""
    friction: Callable[[int, float], None]
    """Of a collider, by its number."""
    place: Callable[[mpm.Pose], None]
    """Displacement of the regions in which grains are counted."""


class World:
    """A sub-task with a material; one environment runs in it, or a batch of them.

    name: of the file that the settled start is cached in. task: if the options have none. `observer.build` completes
    what is observed.
    Raises ConfigError, UnknownName for options that cannot be used.
    """

    def __init__(self, name: str, task: TaskConfig | str, options: EnvOptions = DEFAULT_OPTIONS) -> None:
        load, mobile = options.load, options.arm  # an arm carries the tool, so that contact moves it
        task = options.task or task
        self.task = task if isinstance(task, TaskConfig) else load_task(task)
        if options.tool is not None:
            self.task = self.task.with_tool(options.tool)
        if load is not None:
            self.task = task_with_load(name, self.task, load)
        own = load.material if load is not None and options.material is None else \
            load_material(options.material or self.task.material)
        self.material = overridden(own, options.numbers, "option, or number of this material,")
        self.observer = Perception(self.task, options.perception)
        ranges = choose_ranges(options.randomize, self.task, mobile)
        self.randomization = Randomization(self.task, self.material, ranges, arm=mobile, sensors=self.observer.domains,
                                           volume=None if load is None else load.volume)
        if self.randomization.materials and tool_shape(self.task.tool).holes is not None:
            raise ConfigError(f"randomize: material with the tool {self.task.tool_name!r}, whose holes are made for "
                              f"the grains of one material; accepted: numbers of the material, or another tool")
        if load is not None and self.randomization.varies_grains:
            raise ConfigError(f"randomize: {', '.join(ranges)} with load; accepted with load: neither material, nor "
                              f"fill, nor surface_slope_deg")
        self._name, self.load, law = name, load, self.material.make_law()
        check_substeps("step_dt", self.task.step_dt, largest_step(self.task, law))
        self.solver = build_field(self.task, law, self.task.start.pose, FieldOptions(
            is_carried=mobile, moves_containers=self.randomization.moves_places,
            grain_diameter=grain_diameter_of(self.material),
            grains=None if load is None else Filling(load_positions(self.task, load), load.volume),
            dt=self.randomization.step if self.randomization.materials else None)).solver
        self._home = self.task.start.pose
        self._volumes = {1.0: grain_volume_of(self.solver)}
        """Of a grain [m^3], by the fill."""
        self._unsettled = self.solver.state() if self.randomization.varies_grains else {}
        self._starts: dict[tuple[str, float, float], dict[str, np.ndarray]] = {}
        """Settled states by what `Draw.grains` says of them."""
        self.counter = build_counter(self.task, self.solver)
        self.sample = mpm.Sample(self.solver, self.observer.grains) if len(self.observer.grains) else None
        self.solver.attach(self.counter, self.sample)
        if load is None:
            self._settled = settled_state(name, self.task, self.material, self.solver)
        else:
            self._settled = load_state(self.task, load, self.solver)
            self.solver.load(self._settled)
        self._starts["", 1.0, 0.0] = self._settled

    def draw(self, rng: np.random.Generator, options: StartOptions) -> Draw:
        """Draw what is random in an episode, or take what the options give back."""
        if options.draw is not None:
            return self.randomization.read(options.draw)
        return self.randomization.draw(rng, nominal=options.nominal, shift=options.shift, turn_deg=options.turn_deg)

    def tool_pose(self, draw: Draw) -> mpm.Pose:
        """Return the pose at which the robot believes the tool at the start of an episode."""
        home, action, tool = self._home, self.task.action, np.array(draw.tool)
        position = np.clip(home.position + tool, action.lower, action.upper) if tool.any() else home.position
        return mpm.Pose(position, turned(home.quaternion, draw.turn_deg))

    def setting(self, draw: Draw) -> Setting:
        """Return how the scene of an episode differs from the task's."""
        law = self.randomization.law(draw) or self.material.make_law()
        return self.randomization.setting(draw)._replace(grain_mass=law.density * self._volume_of(draw))

    def _volume_of(self, draw: Draw) -> float:
        """Return the volume [m^3] of a grain in an episode."""
        level = draw.grains[1]
        if level not in self._volumes:
            self._volumes[level] = grain_volume(self.randomization.grains(draw))
        return self._volumes[level]

    def settle(self, draw: Draw) -> dict[str, np.ndarray]:
        """Return the settled state of an episode's grains, in the place of the task.

        The first time it may run the solver, in whose state it leaves it then; the file in the cache saves the next
        process that time.
        """
        if draw.grains not in self._starts:
            task, material = self.randomization.grains(draw), self.randomization.material(draw)
            solver, (_, level, slope) = self.solver, draw.grains
            solver.set_material(0, material.make_law())
            solver.settings.set_volume(0, grain_volume(task))
            frictions = [task.field.tool_friction, *[task.field.container_friction] * (len(solver.colliders) - 1)]
            set_frictions(solver, frictions)
            self.counter.place(HOME)
            grains = fill(task, build_tool_lattice(task), task.start.pose, slope_deg=slope)
            solver.load(self._unsettled | {"x": grains.positions - solver.grid.origin})
            self._starts[draw.grains] = settled_state(self._name, task, material, solver, (level, slope))
        return self._starts[draw.grains]

    @property
    def own_setters(self) -> Setters:
        """What sets the numbers of the world's solver, where they are others."""
        solver = self.solver

        def set_law(law: Law) -> None:
            if law != solver.bodies[0].material:
                solver.set_material(0, law)

        def set_volume(volume: float) -> None:
            if volume != grain_volume_of(solver):
                solver.settings.set_volume(0, volume)

        return Setters(set_law, set_volume, solver.set_friction, self.counter.place)

    def set_numbers(self, draw: Draw, setting: Setting, to: Setters) -> None:
        """Set what an episode has drawn of the field's numbers."""
        law = self.randomization.law(draw)
        if law is not None:
            to.material(law)
        if self.randomization.varies_grains:
            to.volume(self._volume_of(draw))
        for index, friction in self.randomization.frictions(draw, len(self.solver.colliders)).items():
            to.friction(index, friction)
        if self.randomization.moves_places:
            to.place(setting.place)

    def start_state(self, settled: dict[str, np.ndarray], draw: Draw, setting: Setting,
                    tool: mpm.Pose) -> dict[str, np.ndarray]:
        """Return a settled state with the tool at a pose and all else in its place.

        Grains in the tool move with it; others lie where container or pile are.
        """
        state, origin = dict(settled), self.solver.grid.origin
        if self.task.carried:
            local = self._home.inverse().apply(state["x"] + origin)
            state |= rotate_grains(state, tool.matrix @ self._home.matrix.T)
            state["x"] = tool.apply(local) - origin
        else:
            state["x"] = state["x"] + np.array(draw.pile)
            if setting.place is not HOME and self.task.container is not None:
                state |= rotate_grains(state, setting.place.matrix)
                state["x"] += origin
                state["x"] = setting.place.apply(state["x"])
                state["x"] -= origin
        state["poses"] = state["poses"].copy()
        state["poses"][TOOL] = np.concatenate(tool)
        if setting.place is not HOME:
            for index in range(1, len(state["poses"])):
                state["poses"][index] = np.concatenate(setting.place @ self.solver.colliders[index].pose)
        return state

    def grains(self) -> np.ndarray:
        """Return position [m] and velocity [m/s] of the observed grains (n, 6) in the solver's present state."""
        return self.sample.read() if self.sample is not None else NO_GRAINS

    # states ---------------------------------------------------------------------------------------------------------
    def describe(self, **options: Any) -> dict[str, Any]:
        """Return all that a state depends on: task, material, layout, precision, and options of the environment."""
        load = self.load
        handed = None if load is None else hashlib.sha256(np.ascontiguousarray(load.positions).tobytes()).hexdigest()
        return {
            "format": STATE_FORMAT, **options,
            **{f"task.{name}": value for name, value in self.task.model_dump(mode="json").items()},
            "material": type(self.material).__name__,
            **{f"material.{name}": value for name, value in self.material.values().items()},
            "randomize": self.randomization.describe(),
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
            "volume": grain_volume_of(solver),
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
        frictions, volume = [collider.friction for collider in solver.colliders], grain_volume_of(solver)
        try:
            memory = Memory(read_generator(state["generator"]), state["seed"], copy.deepcopy(state["observation"]),
                            copy.deepcopy(state["senses"]), copy.deepcopy(state["waiting"]))
            momentum = None if state["momentum"] is None else Momentum(*np.array(state["momentum"], float))
            episode.load(state["episode"])
            carrier.load(state["carrier"])
            self.counter.load(state["counter"])
            solver.set_material(0, type(before[3])(**state["material"]))
            set_frictions(solver, state["frictions"])
            self.own_setters.volume(state["volume"])
            self.counter.place(carrier.setting.place)
            solver.load(state["solver"])
        except BaseException as error:
            episode.load(before[0])
            carrier.load(before[1])
            self.counter.load(before[2])
            solver.set_material(0, before[3])
            set_frictions(solver, frictions)
            self.own_setters.volume(volume)
            self.counter.place(carrier.setting.place)
            if not isinstance(error, Exception):
                raise
            what = f"it has no {error}" if isinstance(error, KeyError) else error
            raise ConfigError(f"load: the state is incomplete or changed: {what}; accepted: what `state` returned") \
                from error
        if momentum is not None:
            solver.rollback.adopt_state(list(solver.paths.poses), solver.time, solver.steps, momentum)
        return memory


def grain_volume_of(solver: mpm.Solver) -> float:
    """Return the volume [m^3] of a grain in a solver."""
    return np.asarray(solver.bodies[0].volume, float).item()


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

"""The simulated world of a sub-task: field, counter and observer, and the random starts of episodes."""

import hashlib
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.geometry.rigid_motion import rotate
from robosim.base.errors import ConfigError
from robosim.config.materials import Law, grain_diameter_of, load_material, overridden
from robosim.envs.episode import EnvOptions
from robosim.envs.start import StartOptions, rotate_grains, settled_state
from robosim.randomization.randomization import Randomization
from robosim.randomization.ranges import HARD, choose_ranges
from robosim.randomization.variants import hardened
from robosim.scene.field import FieldOptions, build_field, build_tool_lattice, check_substeps, choose_substep
from robosim.scene.grains import Filling, fill, grain_volume, grain_volume_of
from robosim.senses.perception import Perception
from robosim.senses.senses import DRAWN_TIMING
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL, build_counter
from robosim.tasks.draw import HOME, Draw, Setting
from robosim.tasks.handover import load_state, task_with_load
from robosim.tasks.task import TaskConfig, load_task

NO_GRAINS = np.zeros((0, 6), np.float32)
DEFAULT_OPTIONS = EnvOptions()
STATE_FORMAT = 5
"""Raised when a state has other entries."""


class FieldAccess(NamedTuple):
    """What sets and reads the field of one environment."""

    set_material: Callable[[Law], None]
    set_volume: Callable[[float], None]
    """Of a grain [m^3]."""
    set_friction: Callable[[int, float], None]
    """Of a collider, by its number."""
    place: Callable[[mpm.Pose], None]
    """Displaces the regions in which grains are counted."""
    load: Callable[[dict[str, np.ndarray]], tuple[mpm.Counts, mpm.Pose]]
    """Loads a state in which an episode starts, and returns its counts and the tool's pose."""
    grains: Callable[[], np.ndarray]
    """Returns position [m] and velocity [m/s] (n, 6) of the observed grains."""


class World:
    """A sub-task with a material; one environment runs in it, or a batch of them.
    name: of the file that the settled start is cached in. task: if the options have none. `observer.build` completes
    what is observed.
    Raises ConfigError, UnknownName for options that cannot be used."""

    def __init__(self, name: str, task: TaskConfig | str, options: EnvOptions = DEFAULT_OPTIONS) -> None:
        load, mobile = options.load, options.arm  # an arm carries the tool, so that contact moves it
        task = options.task or task
        self.task = task if isinstance(task, TaskConfig) else load_task(task)
        if options.tool is not None:
            self.task = self.task.with_tool(options.tool)
        if options.randomize in HARD:
            self.task = hardened(self.task)
        if load is not None:
            self.task = task_with_load(name, self.task, load)
        own = load.material if load is not None and options.material is None else \
            load_material(options.material or self.task.material)
        self.material = overridden(own, options.numbers, "option, or number of this material,")
        self.observer = Perception(self.task, options.obs, flatten=options.flatten, privileged=options.privileged,
                                   timing={name: getattr(options, name) for name in DRAWN_TIMING})
        ranges = choose_ranges(options.randomize, self.task, mobile, self.observer.domains)
        self.randomization = Randomization(self.task, self.material, ranges, arm=mobile, sensors=self.observer.domains,
                                           volume=None if load is None else load.volume)
        if self.randomization.materials and tool_shape(self.task.tool).holes is not None:
            raise ConfigError(f"randomize: material with the tool {self.task.tool_name!r}, whose holes are made for "
                              f"the grains of one material; accepted: numbers of the material, or another tool")
        if load is not None and self.randomization.varies_grains:
            raise ConfigError(f"randomize: {', '.join(ranges)} with load; accepted with load: neither material, nor "
                              f"fill, nor surface_slope_deg")
        self._name, self.load, self._home, law = name, load, self.task.start.pose, self.material.make_law()
        check_substeps("step_dt", self.task.step_dt, self.randomization.step or choose_substep(self.task, law))
        self.solver = build_field(self.task, law, self._home, FieldOptions(
            is_carried=mobile, moves_containers=self.randomization.moves_places,
            grain_diameter=grain_diameter_of(self.material),
            grains=None if load is None else Filling(self._home.apply(load.positions), load.volume),
            dt=self.randomization.step))
        self._volumes = {1.0: grain_volume_of(self.solver)}
        """Of a grain [m^3], by the fill."""
        self._unsettled = self.solver.state() if self.randomization.varies_grains else {}
        self.counter = build_counter(self.task, self.solver)
        self.sample = mpm.Sample(self.solver, self.observer.grains) if len(self.observer.grains) else None
        self.solver.attach(self.counter, self.sample)
        if load is None:
            settled = settled_state(name, self.task, self.material, self.solver)
        else:
            settled = load_state(self.task, load, self.solver)
            self.solver.load(settled)
        self._starts = {("", 1.0, 0.0): settled}
        """Settled states by what `Draw.grains` says of them."""

    def draw(self, rng: np.random.Generator, options: StartOptions) -> Draw:
        """Draw what is random in an episode, or take what the options give back."""
        if options.draw is not None:
            return self.randomization.read(options.draw)
        return self.randomization.draw(rng, nominal=options.nominal, shift=options.shift, turn_deg=options.turn_deg)

    def tool_pose(self, draw: Draw) -> mpm.Pose:
        """Return the pose at which the robot believes the tool at the start of an episode."""
        home, action, tool = self._home, self.task.action, np.array(draw.tool)
        position = np.clip(home.position + tool, action.lower, action.upper) if tool.any() else home.position
        turn = np.radians([0.0, 0.0, draw.turn_deg])
        return mpm.Pose(position, rotate(home.quaternion, turn) if turn.any() else home.quaternion)

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
        """Return the settled state of an episode's grains, in the place of the task; the solver may be left in it."""
        if draw.grains not in self._starts:
            task, material = self.randomization.grains(draw), self.randomization.material(draw)
            solver, (_, level, slope) = self.solver, draw.grains
            solver.set_material(0, material.make_law())
            solver.settings.set_volume(0, grain_volume(task))
            for index in range(len(solver.colliders)):
                friction = task.field.container_friction if index else task.field.tool_friction
                self.own_field.set_friction(index, friction)
            self.counter.place(HOME)
            grains = fill(task, build_tool_lattice(task), task.start.pose, slope_deg=slope)
            solver.load(self._unsettled | {"x": grains.positions - solver.grid.origin})
            self._starts[draw.grains] = settled_state(self._name, task, material, solver, (level, slope))
        return self._starts[draw.grains]

    @property
    def own_field(self) -> FieldAccess:
        """The field of an environment that has the world's solver for itself; numbers are set where they differ."""
        solver = self.solver

        def set_law(law: Law) -> None:
            if law != solver.bodies[0].material:
                solver.set_material(0, law)

        def set_volume(volume: float) -> None:
            if volume != grain_volume_of(solver):
                solver.settings.set_volume(0, volume)

        def set_friction(index: int, friction: float) -> None:
            if solver.colliders[index].friction != friction:
                solver.set_friction(index, friction)

        def load(state: dict[str, np.ndarray]) -> tuple[mpm.Counts, mpm.Pose]:
            solver.load(state)
            self.counter.restart()
            return self.counter.read(), solver.collider_pose(TOOL)

        return FieldAccess(set_law, set_volume, set_friction, self.counter.place, load, self.grains)

    def set_numbers(self, draw: Draw, setting: Setting, field: FieldAccess) -> None:
        """Set what an episode has drawn of the field's numbers."""
        law = self.randomization.law(draw)
        if law is not None:
            field.set_material(law)
        if self.randomization.varies_grains:
            field.set_volume(self._volume_of(draw))
        for index, friction in self.randomization.frictions(draw, len(self.solver.colliders)).items():
            field.set_friction(index, friction)
        if self.randomization.moves_places:
            field.place(setting.place)

    def start_state(self, settled: dict[str, np.ndarray], draw: Draw, setting: Setting,
                    tool: mpm.Pose) -> dict[str, np.ndarray]:
        """Return a settled state with the tool, and grains in it, at a pose; others are where container or pile are."""
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

    def describe(self, **options: Any) -> dict[str, Any]:
        """Return all that a state depends on: task, material, layout, precision, and options of the environment."""
        load, handed = self.load, None
        if load is not None:
            digest = hashlib.sha256(np.ascontiguousarray(load.positions).tobytes()).hexdigest()
            handed = f"{load.count} grains, {digest}"
        return {"format": STATE_FORMAT, **options,
                **{f"task.{name}": value for name, value in self.task.model_dump(mode="json").items()},
                "material": type(self.material).__name__,
                **{f"material.{name}": value for name, value in self.material.values().items()},
                "randomize": self.randomization.describe(), "obs": self.observer.describe(), "load": handed,
                "precision": self.solver.precision}

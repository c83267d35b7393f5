"""One environment of a world: its episode, what moves its tool, its state, and what it keeps from step to step."""

import copy
from typing import Any

import numpy as np

import mpm
from mpm.observers.diagnostics import Momentum
from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.envs.carrier import Carrier
from robosim.envs.episode import EnvOptions, Episode
from robosim.envs.start import StartOptions
from robosim.envs.world import FieldAccess, World
from robosim.scene.grains import grain_volume_of
from robosim.senses.term import Sight
from robosim.tasks.actions import ActionScaling, DelayLine, delay_steps
from robosim.tasks.draw import Draw, Setting

ATTEMPTS = 16
"""Random starts that are drawn until an arm reaches one."""
Info = dict[str, Any]


class Member:
    """One environment of a world; field: of it alone."""

    def __init__(self, world: World, options: EnvOptions, carrier: Carrier, field: FieldAccess) -> None:
        self.world, self.carrier, self.field, self.episode = world, carrier, field, Episode(world.task, options.horizon)
        self.actions = ActionScaling(world.task, clip=options.clip_actions)
        delay = delay_steps(options.action_delay, world.task.step_dt)
        self.delay = DelayLine(delay, self.actions.rest)
        arm = {"robot": list(options.hardware)} if options.arm else {}
        self.identity = world.describe(action_delay=delay, arm=options.arm, grasp=options.grasp if arm else None,
                                       action_repeat=options.action_repeat, horizon=options.horizon,
                                       clip_actions=options.clip_actions, **arm)
        """All that a state depends on."""
        self.generator: np.random.Generator | None = None
        """None before the first episode."""
        self.seed: int | None = None
        self.observation: Any = None
        """The last one."""
        self._senses: Any = None

    @property
    def has_ended(self) -> bool:
        """Whether its last episode has ended."""
        return self.generator is not None and not self.episode.running

    def start(self, options: StartOptions) -> Info:
        """Start an episode; return its info.
        Raises UnreachableWaypoint where an arm reaches none of ATTEMPTS random starts, or not one that is asked for."""
        world = self.world
        draw, setting, tool = self._restart_carrier(options)
        settled = world.settle(draw)
        world.set_numbers(draw, setting, self.field)
        counts, pose = self.field.load(world.start_state(settled, draw, setting, tool))
        self.delay.restart()
        info = self.episode.restart(pose, counts, setting)
        sight = self.look(self.field.grains())
        self._senses = world.observer.begin(sight, draw.sensors, world.randomization.sensors(draw))
        return info | self._observe(sight) | {"draw": draw._asdict()}

    def _restart_carrier(self, options: StartOptions) -> tuple[Draw, Setting, mpm.Pose]:
        """Draw an episode that the carrier can begin, and begin it; return the tool's pose, too."""
        assert self.generator is not None
        for attempt in range(ATTEMPTS):
            draw = self.world.draw(self.generator, options)
            setting = self.world.setting(draw)
            try:
                return draw, setting, self.carrier.restart(self.world.tool_pose(draw), setting)
            except UnreachableWaypoint:
                if options.draw is not None or options.nominal or attempt == ATTEMPTS - 1:
                    raise
        raise AssertionError("unreachable")

    def end_action(self, grains: np.ndarray) -> tuple[float, bool, bool, Info]:
        """Observe, unless the simulation diverged; return the action's reward, terminated, truncated and info."""
        sensed = self._observe(self.look(grains)) if self.episode.diverged is None else {}
        reward, terminated, truncated, info = self.episode.end_action()
        return reward, terminated, truncated, info | sensed

    def look(self, grains: np.ndarray) -> Sight:
        """Return what the terms of the observation see now."""
        episode, carrier = self.episode, self.carrier
        qpos = None if carrier.robot_data is None else carrier.robot_data.qpos
        return Sight(episode.time, episode.step_count / episode.task.steps, episode.pose, episode.counts, grains,
                     carrier.received, carrier.duration, carrier.setting, carrier.sensors, qpos,
                     self.delay.waiting)

    def _observe(self, sight: Sight) -> Info:
        self.observation = self.world.observer.read(sight, self._senses)
        return self.world.observer.read_info(sight, self._senses)

    def state(self) -> dict[str, Any]:
        """Return the state of the environment, whose field the solver holds now: arrays and plain values."""
        solver = self.world.solver
        # an arm's ledger begins with the momentum of the grains, summed in the order of the last launch
        momentum = np.array(solver.momentum_after_advance()) if solver.features.mobile else None
        return {"options": dict(self.identity), "solver": solver.state(), "momentum": momentum, **self._rest_of_state()}

    def _rest_of_state(self) -> dict[str, Any]:
        solver, generator = self.world.solver, self.generator
        return {
            "material": dict(vars(solver.bodies[0].material)), "volume": grain_volume_of(solver),
            "frictions": [collider.friction for collider in solver.colliders], "counter": self.world.counter.state(),
            "episode": self.episode.state(), "carrier": self.carrier.state(),
            "generator": None if generator is None else generator.bit_generator.state, "seed": self.seed,
            "observation": copy.deepcopy(self.observation), "senses": copy.deepcopy(self._senses),
            "waiting": copy.deepcopy(self.delay.waiting),
        }

    def load(self, state: dict[str, Any]) -> None:
        """Continue from a state.
        Raises ConfigError, and changes nothing, for a state of other options, and for one that lacks something."""
        check_options(state, self.identity)
        solver, before = self.world.solver, self._rest_of_state()
        try:
            momentum = None if state["momentum"] is None else Momentum(*np.array(state["momentum"], float))
            self._take_rest(state)
            solver.load(state["solver"])
        except BaseException as error:
            self._take_rest(before)
            if not isinstance(error, Exception):
                raise
            what = f"it has no {error}" if isinstance(error, KeyError) else error
            raise ConfigError(f"load: the state is incomplete or changed: {what}; accepted: what `state` returned") \
                from error
        if momentum is not None:
            solver.rollback.adopt_state(list(solver.paths.poses), solver.time, solver.steps, momentum)

    def _take_rest(self, state: dict[str, Any]) -> None:
        world, solver = self.world, self.world.solver
        self.generator, self.seed = None, state["seed"]
        if state["generator"] is not None:
            bits = getattr(np.random, state["generator"]["bit_generator"])(0)
            bits.state = state["generator"]
            self.generator = np.random.Generator(bits)
        self.observation, self._senses = copy.deepcopy(state["observation"]), copy.deepcopy(state["senses"])
        self.delay.waiting = copy.deepcopy(state["waiting"])
        self.episode.load(state["episode"])
        self.carrier.load(state["carrier"])
        world.counter.load(state["counter"])
        solver.set_material(0, type(solver.bodies[0].material)(**state["material"]))
        for index, friction in enumerate(state["frictions"]):
            world.own_field.set_friction(index, friction)
        world.own_field.set_volume(state["volume"])
        world.counter.place(self.carrier.setting.place)


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

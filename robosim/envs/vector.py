"""Vector environments: `gymnasium.make_vec("robosim/SpoonPour-v0", num_envs=8)`.

Environments of one process share a field and a launch; with several cores there is a process for each. With an arm or
pictures, every environment has a field of its own and, by default, a process of its own. Processes are spawned, because
a forked one could not use a GPU. A script that makes a vector environment therefore needs
`if __name__ == "__main__":`, or `workers=1`.

autoreset_mode says when an environment that ended starts again: in the same step (the default: no action is ignored,
and every row is a transition), in the next step, as Gymnasium's own vector environments do and some of its wrappers
need, or when `reset` is called with a mask.
"""

import os
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from robosim.base.errors import ConfigError, RobosimError, UnknownName
from robosim.envs.batch import GrainBatch, Info
from robosim.envs.episode import HasCopies, HasEpisodeLength, check_open
from robosim.envs.remote_batch import BatchError, EnvBatch, RemoteBatch, call_batch


def make_vector(name: str, num_envs: int, *, arm: bool = False, render_mode: str | None = None,
                workers: int | None = None, autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
                **options: Any) -> gymnasium.vector.VectorEnv:
    """Make the vector environment of a sub-task; options go to every environment.

    workers: processes; None: one per core, with an arm or pictures one per environment.
    Raises ConfigError, UnknownName for num_envs, workers or autoreset_mode that cannot be used.
    """
    options.pop("max_episode_steps", None)  # the task's own horizon holds
    if num_envs < 1:
        raise ConfigError(f"num_envs = {num_envs}; accepted: a whole number from 1 on")
    if not arm and render_mode is None:
        for unused in ("grasp", "camera", "robot", "gripper"):  # options of arms and pictures
            options.pop(unused, None)
        return GrainVectorEnv(name, num_envs, workers=workers, autoreset_mode=autoreset_mode, **options)
    return ProcessVectorEnv(name, num_envs, workers=num_envs if workers is None else workers,
                            autoreset_mode=autoreset_mode, arm=arm, render_mode=render_mode, **options)


def check_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the mode with this name or value; raises UnknownName where there is none."""
    for known in AutoresetMode:
        if mode in (known, known.value, known.name):
            return known
    raise UnknownName("autoreset_mode", mode, [known.value for known in AutoresetMode])


class GrainVectorEnv(HasCopies, HasEpisodeLength, gymnasium.vector.VectorEnv):
    """Environments of one sub-task that step together.

    autoreset_mode: SAME_STEP: an environment that ends starts again in the same step; its last observation and info are
    in `infos["final_obs"]` and `infos["final_info"]`. NEXT_STEP: they are returned as those of any step; the next step
    ignores its action and starts, with reward 0. DISABLED: the same, and `reset` with a "reset_mask" starts it.
    workers: processes; None: one per core, at most one per environment; 1: this process.
    """

    _kind: type[GrainBatch | EnvBatch] = GrainBatch
    """What the environments of a process are in."""

    def __init__(self, name: str, num_envs: int, *, workers: int | None = None,
                 autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP, **options: Any) -> None:
        options["autoreset_mode"] = check_autoreset_mode(autoreset_mode)
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        workers = min(num_envs, cores if workers is None else workers)
        if workers < 1:
            raise ConfigError(f"workers = {workers}; accepted: a whole number from 1 on, or None")
        self.num_envs, self.metadata = num_envs, {"autoreset_mode": options["autoreset_mode"]}
        self._ended = np.zeros(num_envs, bool)
        """Which environments wait for `reset`; none unless the mode is DISABLED."""
        sizes = [len(part) for part in np.array_split(np.arange(num_envs), workers)]
        ends = np.cumsum(sizes)
        self._parts = [slice(end - size, end) for end, size in zip(ends, sizes)]
        self.batches: list[Any] = []
        """Batches of the environments, in this process or in others."""
        try:
            for part, size in zip(self._parts, sizes):
                kind = self._kind if workers == 1 else partial(RemoteBatch, self._kind, first=int(part.start))
                self.batches.append(kind(name, size, **options))
            self.single_observation_space, self._actions, self.max_episode_steps, own = self._call("describe")[0]
        except BaseException:
            self.close()
            raise
        self.metadata |= {key: value for key, value in own.items() if key != "autoreset_mode"}
        self.single_action_space = self._actions.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed: int | list[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[Any, Info]:
        """Start episodes; return observations and infos.

        seed: one number, raised by one from environment to environment, or a list. options: {"nominal": True} for the
        start without random displacement, "reset_mask" (n,) for the environments that start again.
        Raises ConfigError, UnknownName for a seed or options that cannot be used.
        """
        check_open("reset", self.closed)
        seeds = [None if seed is None else seed + e for e in range(self.num_envs)] if not isinstance(seed, list) \
            else seed
        if len(seeds) != self.num_envs:
            raise ConfigError(f"seed has {len(seeds)} entries; accepted: {self.num_envs}, or one number")
        options = dict(options or {})
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ConfigError(f"reset_mask = {mask}; accepted: {self.num_envs} of True or False, some of them True")
        results = self._call("reset", *[(seeds[part], options, mask[part]) for part in self._parts])
        self._ended[mask] = False
        infos: Info = {}
        for e, info in enumerate(info for _, part in results for info in part):
            infos = self._add_info(infos, info, e)
        return self._stack([observation for part, _ in results for observation in part]), infos

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, Info]:
        """Apply actions (n, dimensions); return observations, rewards, terminated, truncated and infos.

        Raises ConfigError for an action that cannot be used, and for an environment that waits for `reset`, before any
        environment moves.
        """
        check_open("step", self.closed)
        if self._ended.any():  # checked here like the actions, or one process would step while another refuses
            raise ConfigError(f"environments {', '.join(map(str, np.flatnonzero(self._ended)))} have ended; with "
                              f"autoreset_mode DISABLED call reset(options={{\"reset_mask\": ...}}) first")
        if np.shape(actions) != self.action_space.shape:
            raise ConfigError(f"actions have shape {np.shape(actions)}; accepted: {self.action_space.shape}")
        for e, action in enumerate(actions):
            self._actions.velocities(action, f"action of environment {e}")
        results = self._call("step", *[(actions[part],) for part in self._parts])
        infos: Info = {}
        pairs = [(info, final) for result in results for info, final in zip(*result[4:])]
        for e, (info, final) in enumerate(pairs):
            infos = self._add_info(self._add_info(infos, final, e), info, e)
        rewards, terminated, truncated = (np.concatenate([result[k] for result in results]) for k in (1, 2, 3))
        if self.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            self._ended = terminated | truncated
        observations = self._stack([observation for result in results for observation in result[0]])
        return observations, rewards, terminated, truncated, infos

    def state(self, index: int) -> dict[str, Any]:
        """Return the state of one environment, as `GrainEnv.state` does; raises ConfigError after `close`."""
        return self._call_one("state", index)

    def load(self, index: int, state: dict[str, Any]) -> None:
        """Continue one environment from a state of any, in this vector or alone, with the same task and options.

        Raises ConfigError, and changes nothing, for another one, with SAME_STEP for a state without a running episode,
        and after `close`.
        """
        self._call_one("load", index, state)
        self._ended[index] = self.metadata["autoreset_mode"] is AutoresetMode.DISABLED and \
            not state["episode"]["running"]

    def _call_one(self, method: str, index: int, *arguments: Any) -> Any:
        """Call a method of the batch that has an environment."""
        check_open(method, self.closed)
        if not isinstance(index, int | np.integer) or not 0 <= index < self.num_envs:
            raise ConfigError(f"{method}: index = {index!r}; accepted: 0 to {self.num_envs - 1}")
        k, part = next((k, part) for k, part in enumerate(self._parts) if index < part.stop)
        return self._call(method, (int(index) - part.start, *arguments), batches=[self.batches[k]])[0]

    def _travelling(self) -> tuple[Any, ...]:
        states = [self.state(e) for e in range(self.num_envs)]
        return states, self._spec, self.action_space, self.observation_space

    def _arrive(self, state: tuple[Any, ...]) -> None:
        states, self._spec, self.action_space, self.observation_space = state
        for e, one in enumerate(states):
            if one["generator"] is not None:  # otherwise it never began, here as there
                self.load(e, one)

    def _stack(self, observations: list[Any]) -> Any:
        """Stack observations into one array, or into one for each part."""
        return concatenate(self.single_observation_space, observations,
                           create_empty_array(self.single_observation_space, self.num_envs))

    def _call(self, method: str, *arguments: tuple, batches: list[Any] | None = None) -> list[Any]:
        """Call a method of batches (None: all) at once, with arguments for each; return their results."""
        batches = self.batches if batches is None else batches
        per_batch = arguments or [()] * len(batches)
        if not isinstance(batches[0], RemoteBatch):
            return [call_batch(batches[0], method, per_batch[0])]
        try:
            for batch, these in zip(batches, per_batch):
                batch.send(method, these)
            results = [batch.receive() for batch in batches]
        except BaseException:  # a result left in a pipe would be taken for that of a later request
            self.close()
            raise
        for result in results:
            if isinstance(result, BatchError):
                raise result.error from RobosimError(result.traceback)
        return results

    def close_extras(self, **_: Any) -> None:
        """End the processes, or free the field in this one."""
        for batch in self.batches:
            batch.close()


class ProcessVectorEnv(GrainVectorEnv):
    """Environments of one sub-task with an arm or pictures; each has a field of its own and can be called by itself.

    Arguments as of `GrainVectorEnv`. workers: 1: this process, where the environments step one after another.
    """

    _kind = EnvBatch

    def __init__(self, name: str, num_envs: int, *, render_mode: str | None = None, **options: Any) -> None:
        self.render_mode = render_mode
        super().__init__(name, num_envs, render_mode=render_mode, **options)

    def render(self) -> tuple[Any, ...]:
        """Return the picture of each environment, or show it, as `GrainEnv.render` does."""
        return self.call("render")

    def call(self, name: str, *arguments: Any, **options: Any) -> tuple[Any, ...]:
        """Call a method of each environment; return the results, or the values of an attribute.

        Raises ConfigError for a method that this vector environment has itself, and after `close`.
        """
        check_open("call", self.closed)
        if name in ("reset", "step", "load", "close"):
            raise ConfigError(f"call: name = {name!r}; accepted: another method or an attribute; call {name} of the "
                              f"vector environment")
        parts = self._call("call", *[(name, arguments, options)] * len(self.batches))
        return tuple(result for part in parts for result in part)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of each environment; values: a list or tuple with one for each, or one for all.

        Raises ConfigError for a list or tuple of another length, and after `close`.
        """
        check_open("set_attr", self.closed)
        each = list(values) if isinstance(values, list | tuple) else [values] * self.num_envs
        if len(each) != self.num_envs:
            raise ConfigError(f"set_attr: values has {len(each)} entries; accepted: {self.num_envs}, or one value")
        self._call("set_attr", *[(name, each[part]) for part in self._parts])

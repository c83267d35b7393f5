"""Vector environments: `gymnasium.make_vec("robosim/SpoonPour-v0", num_envs=8)`.
Environments of one process share a field and a launch; with several cores there is a process for each. With an arm or
pictures, every environment has a field of its own and, by default, a process of its own. Processes are spawned, because
a forked one could not use a GPU: a script that makes them needs `if __name__ == "__main__":`, or `workers=1`."""

import contextlib
import multiprocessing
import os
import time
import traceback
from functools import partial
from itertools import chain
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

import mpm
from mpm.backend import numerics
from robosim.base.errors import ConfigError, RobosimError, UnknownName
from robosim.envs.batch import EnvBatch, GrainBatch
from robosim.envs.episode import Copied, check_open
from robosim.envs.member import Info
from robosim.envs.start import copy_options


def make_vector(name: str, num_envs: int, *, arm: bool = False, render_mode: str | None = None,
                workers: int | None = None, autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
                **options: Any) -> gymnasium.vector.VectorEnv:
    """Make the vector environment of a sub-task; arguments as of `GrainVectorEnv`, options as of `GrainEnv`.
    workers: None: one per core, with an arm or pictures one per environment."""
    options.pop("max_episode_steps", None)  # the task's own horizon holds
    if num_envs < 1:
        raise ConfigError(f"num_envs = {num_envs}; accepted: a whole number from 1 on")
    if not arm and render_mode is None:
        for unused in ("grasp", "camera", "robot", "gripper"):  # options of arms and pictures
            options.pop(unused, None)
        return GrainVectorEnv(name, num_envs, workers=workers, autoreset_mode=autoreset_mode, **options)
    return ProcessVectorEnv(name, num_envs, workers=num_envs if workers is None else workers,
                            autoreset_mode=autoreset_mode, arm=arm, render_mode=render_mode, **options)


class GrainVectorEnv(Copied, gymnasium.vector.VectorEnv):
    """Environments of one sub-task that step together.

    autoreset_mode: SAME_STEP: an environment that ends starts again in the same step, so that no action is ignored; its
    last observation and info are in `infos["final_obs"]` and `infos["final_info"]`. NEXT_STEP, as Gymnasium's own
    vector environments do: they are returned as those of any step; the next step ignores its action and starts, with
    reward 0. DISABLED: the same, and `reset` with a "reset_mask" starts it. workers: processes; None: one per core, at
    most one per environment; 1: this process. Raises ConfigError, UnknownName for arguments that cannot be used."""

    _kind: type[GrainBatch] = GrainBatch
    """What the environments of a process are in."""

    def __init__(self, name: str, num_envs: int, *, workers: int | None = None,
                 autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP, **options: Any) -> None:
        known = [mode for mode in AutoresetMode if autoreset_mode in (mode, mode.value, mode.name)]
        if not known:
            raise UnknownName("autoreset_mode", autoreset_mode, [mode.value for mode in AutoresetMode])
        options["autoreset_mode"] = known[0]
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
        seed: one number, raised by one from environment to environment, or a list. options: as of `GrainEnv.reset`, and
        "reset_mask" (n,) for the environments that start. Raises ConfigError, UnknownName for what cannot be used."""
        check_open("reset", self.closed)
        seeds = [None if seed is None else seed + e for e in range(self.num_envs)] if not isinstance(seed, list) \
            else seed
        if len(seeds) != self.num_envs:
            raise ConfigError(f"seed has {len(seeds)} entries; accepted: {self.num_envs}, or one number")
        options = copy_options(options)
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ConfigError(f"reset_mask = {mask}; accepted: {self.num_envs} of True or False, some of them True")
        results = self._call("reset", *[(seeds[part], options, mask[part]) for part in self._parts])
        self._ended[mask] = False
        infos: Info = {}
        for e, info in enumerate(info for _, part in results for info in part):
            infos = self._add_info(infos, info, e)
        return self._stack([part for part, _ in results]), infos

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, Info]:
        """Apply actions (n, dimensions); return observations, rewards, terminated, truncated and infos.
        Raises ConfigError for an action that cannot be used, or an environment without episode, before any moves."""
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
        return self._stack([result[0] for result in results]), rewards, terminated, truncated, infos

    def state(self, index: int) -> dict[str, Any]:
        """Return the state of one environment, as `GrainEnv.state` does; raises ConfigError after `close`."""
        return self._call_one("state", index)

    def load(self, index: int, state: dict[str, Any]) -> None:
        """Continue one environment from a state of any, in this vector or alone, with the same task and options.
        Raises ConfigError, and changes nothing, for others, and with SAME_STEP where no episode is running."""
        self._call_one("load", index, state)
        self._ended[index] = self.metadata["autoreset_mode"] is AutoresetMode.DISABLED and \
            not state["episode"]["running"]

    def _call_one(self, method: str, index: int, *arguments: Any) -> Any:
        check_open(method, self.closed)
        if not isinstance(index, int | np.integer) or not 0 <= index < self.num_envs:
            raise ConfigError(f"{method}: index = {index!r}; accepted: 0 to {self.num_envs - 1}")
        batch, part = next((batch, part) for batch, part in zip(self.batches, self._parts) if index < part.stop)
        return self._call(method, (int(index) - part.start, *arguments), batches=[batch])[0]

    def _all_states(self) -> list[dict[str, Any]]:
        return [self.state(e) for e in range(self.num_envs)]

    def _load_all(self, state: list[dict[str, Any]]) -> None:
        for e, one in enumerate(state):
            if one["generator"] is not None:  # otherwise it never began, here as there
                self.load(e, one)

    def _stack(self, parts: list[list[Any]]) -> Any:
        """Stack the observations of all batches into one array, or into one for each term."""
        space = self.single_observation_space
        return concatenate(space, list(chain(*parts)), create_empty_array(space, self.num_envs))

    def _call(self, method: str, *arguments: tuple, batches: list[Any] | None = None) -> list[Any]:
        """Call a method of batches (None: all) at once, with arguments for each; return their results."""
        batches = self.batches if batches is None else batches
        per_batch = arguments or [()] * len(batches)
        if not isinstance(batches[0], RemoteBatch):
            return [getattr(batches[0], method)(*per_batch[0])]
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
    """Environments of one sub-task with an arm or pictures; each has a field of its own and can be called by itself."""

    _kind = EnvBatch

    def __init__(self, name: str, num_envs: int, *, render_mode: str | None = None, **options: Any) -> None:
        self.render_mode = render_mode
        super().__init__(name, num_envs, render_mode=render_mode, **options)

    def render(self) -> tuple[Any, ...]:
        """Return the picture of each environment, or show it, as `GrainEnv.render` does."""
        return self.call("render")

    def call(self, name: str, *arguments: Any, **options: Any) -> tuple[Any, ...]:
        """Call a method of each environment that this has not itself; return results, or the values of an attribute."""
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
        """Set an attribute of each environment; values: a list or tuple with one for each, or one for all."""
        check_open("set_attr", self.closed)
        each = list(values) if isinstance(values, list | tuple) else [values] * self.num_envs
        if len(each) != self.num_envs:
            raise ConfigError(f"set_attr: values has {len(each)} entries; accepted: {self.num_envs}, or one value")
        self._call("set_attr", *[(name, each[part]) for part in self._parts])


class BatchError(NamedTuple):
    """An error that a process returned instead of a result."""

    error: Exception
    traceback: str
    """Its traceback in that process."""


class RemoteBatch:
    """A batch in a spawned process, with the precision and fast_math of this one; first: number of its first member."""

    def __init__(self, kind: type[GrainBatch], name: str, n: int, *, first: int, **options: Any) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(other_end, numerics(), kind, name, n, options),
                                       daemon=True, name=f"environments {first} to {first + n - 1}")
        self.process.start()
        other_end.close()

    def send(self, method: str, arguments: tuple) -> None:
        """Send a request; `receive` returns its result."""
        with contextlib.suppress(OSError):  # the process has ended, which `receive` reports
            self._pipe.send((method, arguments))

    def receive(self) -> Any:
        """Receive the result of the last request, or a BatchError."""
        try:
            return self._pipe.recv()
        except (EOFError, OSError):
            time.sleep(1.0)  # a signal to the whole group, which may have ended it first, comes to this process, too
            return BatchError(RobosimError(f"the process of {self.process.name} ended with exit code "
                                           f"{self.process.exitcode}"), "while it handled a request")

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self.process.join(5.0)
        if self.process.is_alive():
            self.process.terminate()
            self.process.join()


def _serve(pipe: Connection, session: dict[str, Any], kind: type[GrainBatch], name: str, n: int,
           options: dict[str, Any]) -> None:
    """Handle requests until the other end closes; session: arguments of `mpm.init`."""
    try:
        mpm.init(**session)
        batch = kind(name, n, **options)
    except Exception as error:
        batch, failure = None, BatchError(error, traceback.format_exc())
    else:
        failure = None
    while True:
        try:
            method, arguments = pipe.recv()
        except (EOFError, KeyboardInterrupt):
            if batch is not None:
                batch.close()
            return
        try:
            result = failure if batch is None else getattr(batch, method)(*arguments)
        except KeyboardInterrupt:
            return
        except Exception as error:
            result = BatchError(error, traceback.format_exc())
        try:
            pipe.send(result)
        except OSError:  # the other end has closed
            return
        except Exception as error:  # nothing was sent, because pickling comes first
            refused = ConfigError(f"{method}: the result of {arguments!r:.60} cannot be pickled: {error}; accepted: "
                                  f"one that can, or workers=1, where all is in one process")
            pipe.send(BatchError(refused, traceback.format_exc()))

"""Several environments at once: `gymnasium.make_vec("robosim/SpoonPour-v0", num_envs=8)`.

Those of one process share a field and a launch; with more than one core they are dealt out to a process for each.
Processes are spawned, never forked: the backend of the field does not survive a fork. Hence a script that makes one
needs the usual `if __name__ == "__main__":`, or `workers=1`.
"""

import contextlib
import multiprocessing
import os
import traceback
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from robosim.envs.batch import GrainBatch, Info
from robosim.errors import ConfigError, RobosimError


def make_vector(name: str, num_envs: int, *, arm: bool = False, render_mode: str | None = None,
                workers: int | None = None, **options: Any) -> gymnasium.vector.VectorEnv:
    """The vector environment of a sub-task; options go to every environment. Arms and pictures are not shared: with
    them every environment has a process of its own."""
    options.pop("max_episode_steps", None)  # the task's own horizon holds
    if num_envs < 1:
        raise ConfigError(f"num_envs = {num_envs}; accepted: a whole number from 1 on")
    if not arm and render_mode is None:
        for unused in ("grasp", "camera"):  # of arms and pictures
            options.pop(unused, None)
        return GrainVectorEnv(name, num_envs, workers=workers, **options)
    if workers not in (None, num_envs):
        raise ConfigError(f"workers = {workers}; accepted with an arm or pictures: None, one for each environment")
    whole = options | {"arm": arm, "render_mode": render_mode}
    return AsyncVectorEnv([partial(_one, name, whole)] * num_envs, context="spawn",
                          autoreset_mode=AutoresetMode.SAME_STEP)


def _one(name: str, options: dict[str, Any]) -> gymnasium.Env:
    """One whole environment, in its process."""
    import robosim  # noqa: F401  (registers the ids there)

    return gymnasium.make(f"robosim/{name}-v0", **options)


class GrainVectorEnv(gymnasium.vector.VectorEnv):
    """Environments of one sub-task in step; one that ends begins anew in the same step, and its last observation and
    info are in `infos["final_obs"]` and `infos["final_info"]`.

    workers: processes, None: as many as there are cores and environments; 1: this process alone.
    """

    def __init__(self, name: str, num_envs: int, *, workers: int | None = None, **options: Any) -> None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        workers = min(num_envs, cores if workers is None else workers)
        if workers < 1:
            raise ConfigError(f"workers = {workers}; accepted: a whole number from 1 on, or None")
        self.num_envs, self.metadata = num_envs, {"autoreset_mode": AutoresetMode.SAME_STEP}
        sizes = [len(part) for part in np.array_split(np.arange(num_envs), workers)]
        ends = np.cumsum(sizes)
        self._parts = [slice(end - size, end) for end, size in zip(ends, sizes)]
        self._batches: list[Any] = []
        try:
            for part, size in zip(self._parts, sizes):
                kind = GrainBatch if workers == 1 else partial(Remote, first=int(part.start))
                self._batches.append(kind(name, size, **options))
            self.single_observation_space, self._actions = self._all("spaces")[0]
        except BaseException:
            self.close()
            raise
        self.single_action_space = self._actions.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed: int | list[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[Any, Info]:
        """Start episodes; options: {"nominal": True}, and "reset_mask" (n,) where only some begin anew."""
        seeds = [None if seed is None else seed + e for e in range(self.num_envs)] if not isinstance(seed, list) \
            else seed
        if len(seeds) != self.num_envs:
            raise ConfigError(f"seed has {len(seeds)} entries; accepted: {self.num_envs}, or one number")
        options = dict(options or {})
        chosen = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, bool)))
        if chosen.shape != (self.num_envs,) or chosen.dtype != bool or not chosen.any():
            raise ConfigError(f"reset_mask = {chosen}; accepted: {self.num_envs} of True or False, some of them True")
        answers = self._all("reset", *[(seeds[part], options, chosen[part]) for part in self._parts])
        infos: Info = {}
        for e, info in enumerate(info for _, part in answers for info in part):
            infos = self._add_info(infos, info, e)
        return self._joined([seen for part, _ in answers for seen in part]), infos

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, Info]:
        """Hold an action (n, dimensions) in each."""
        if np.shape(actions) != self.action_space.shape:
            raise ConfigError(f"actions have shape {np.shape(actions)}; accepted: {self.action_space.shape}")
        for e, action in enumerate(actions):  # here: one process must not step while another refuses
            self._actions.velocities(action, f"action of environment {e}")
        answers = self._all("step", *[(actions[part],) for part in self._parts])
        infos: Info = {}
        every = [(info, final) for answer in answers for info, final in zip(*answer[4:])]
        for e, (info, final) in enumerate(every):
            infos = self._add_info(self._add_info(infos, final, e), info, e)
        rewards, ended, cut = (np.concatenate([answer[k] for answer in answers]) for k in (1, 2, 3))
        return self._joined([seen for answer in answers for seen in answer[0]]), rewards, ended, cut, infos

    def _joined(self, seen: list[Any]) -> Any:
        """Observations in one array, or one for each part."""
        return concatenate(self.single_observation_space, seen,
                           create_empty_array(self.single_observation_space, self.num_envs))

    def _all(self, what: str, *arguments: tuple) -> list[Any]:
        """Ask all batches at once."""
        given = arguments or [()] * len(self._batches)
        if len(self._batches) == 1 and isinstance(self._batches[0], GrainBatch):
            return [asked(self._batches[0], what, given[0])]
        try:
            for batch, these in zip(self._batches, given):
                batch.send(what, these)
            answers = [batch.receive() for batch in self._batches]
        except BaseException:  # an answer that is left would be taken for that to a later question
            self.close()
            raise
        for answer in answers:
            if isinstance(answer, Failure):
                raise answer.error from RobosimError(answer.where)
        return answers

    def close_extras(self, **_: Any) -> None:
        """End the processes."""
        for batch in self._batches:
            if isinstance(batch, Remote):
                batch.close()


def asked(batch: GrainBatch, what: str, arguments: tuple) -> Any:
    """What a batch answers."""
    if what == "spaces":
        return batch.observation_space, batch.actions
    return getattr(batch, what)(*arguments)


class Failure(NamedTuple):
    """What came instead of an answer."""

    error: Exception
    where: str
    """Its traceback in the other process."""


class Remote:
    """A batch in a process of its own."""

    def __init__(self, name: str, n: int, *, first: int, **options: Any) -> None:
        context = multiprocessing.get_context("spawn")
        self._here, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there, name, n, options), daemon=True,
                                        name=f"environments {first} to {first + n - 1}")
        self._process.start()
        there.close()

    def send(self, what: str, arguments: tuple) -> None:
        """Ask."""
        with contextlib.suppress(OSError):  # the process has ended; `receive` says so
            self._here.send((what, arguments))

    def receive(self) -> Any:
        """Its answer, or the error that came instead."""
        try:
            return self._here.recv()
        except (EOFError, OSError):
            self._process.join(1.0)
            return Failure(RobosimError(f"the process of {self._process.name} ended with exit code "
                                        f"{self._process.exitcode}"), "while it was asked")

    def close(self) -> None:
        """End the process."""
        self._here.close()
        self._process.join(5.0)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()


def _serve(pipe: Connection, name: str, n: int, options: dict[str, Any]) -> None:
    """Answer until the other end closes."""
    try:
        batch = GrainBatch(name, n, **options)
    except Exception as error:
        batch, failure = None, Failure(error, traceback.format_exc())
    else:
        failure = None
    while True:
        try:
            what, arguments = pipe.recv()
        except (EOFError, KeyboardInterrupt):
            return
        try:
            answer = failure if batch is None else asked(batch, what, arguments)
        except KeyboardInterrupt:
            return
        except Exception as error:
            answer = Failure(error, traceback.format_exc())
        try:
            pipe.send(answer)
        except OSError:  # nobody is there any more
            return

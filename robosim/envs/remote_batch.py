"""Environments that step one after another, and batches of environments in processes of their own."""

import contextlib
import multiprocessing
import traceback
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

import mpm
from mpm.backend import numerics
from robosim.base.errors import ConfigError, RobosimError
from robosim.envs.batch import BatchStep, GrainBatch, Info, check_mask, check_running


class EnvBatch:
    """n environments, with an arm or pictures, that step one after another; each has a field and kernels of its own.

    Methods as of `GrainBatch`, options as of `GrainEnv`.
    """

    def __init__(self, name: str, n: int, *, autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
                 **options: Any) -> None:
        self.autoreset_mode = autoreset_mode
        self.envs: list[Any] = [gymnasium.make(f"robosim/{name}-v0", disable_env_checker=True, **options).unwrapped
                                for _ in range(n)]
        env = self.envs[0]
        self.metadata, self.actions, self.max_episode_steps = env.metadata, env.actions, env.max_episode_steps
        self.observation_space, self.action_space = env.observation_space, env.action_space

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None,
              mask: np.ndarray) -> tuple[list[Any], list[Info]]:
        """Start episodes in the environments of a mask (n,); infos of the others are empty."""
        check_mask(mask, [env.observation is not None for env in self.envs])
        infos = [env.reset(seed=seed, options=options)[1] if now else {}
                 for env, seed, now in zip(self.envs, seeds, mask)]
        return [env.observation for env in self.envs], infos

    def state(self, e: int) -> dict[str, Any]:
        """Return the state of environment e."""
        return self.envs[e].state()

    def load(self, e: int, state: dict[str, Any]) -> None:
        """Continue environment e from a state of any environment with the same task and options."""
        check_running(state, self.autoreset_mode)
        self.envs[e].load(state)

    def step(self, actions: np.ndarray) -> BatchStep:
        """Apply actions (n, dimensions)."""
        n = len(self.envs)
        starts = [self.autoreset_mode is AutoresetMode.NEXT_STEP and env.observation is not None
                  and not env.episode.running for env in self.envs]
        for env, now in zip(self.envs, starts):
            if not now:  # raises here where no episode is running, before any environment moves
                env.episode.begin_action(env.action_repeat)
        rewards, terminated, truncated = np.zeros(n), np.zeros(n, bool), np.zeros(n, bool)
        infos: list[Info] = [{} for _ in range(n)]
        finals: list[Info] = [{} for _ in range(n)]
        for e, env in enumerate(self.envs):
            if starts[e]:
                infos[e] = env.reset()[1]
                continue
            observation, rewards[e], terminated[e], truncated[e], infos[e] = env.step(actions[e])
            if not env.episode.running and self.autoreset_mode is AutoresetMode.SAME_STEP:
                finals[e] = {"final_obs": observation, "final_info": infos[e]}
                infos[e] = env.reset()[1]
        return [env.observation for env in self.envs], rewards, terminated, truncated, infos, finals

    def call(self, name: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> list[Any]:
        """Call a method of each environment with arguments; return the results, or the values of an attribute."""
        found = [getattr(env, name) for env in self.envs]
        return [one(*arguments, **options) if callable(one) else one for one in found]

    def set_attr(self, name: str, values: list[Any]) -> None:
        """Set an attribute of each environment."""
        for env, value in zip(self.envs, values):
            setattr(env, name, value)

    def close(self) -> None:
        """Close the environments; this batch is of no more use."""
        for env in self.envs:
            env.close()


Batch = GrainBatch | EnvBatch


class BatchError(NamedTuple):
    """An error that a process returned instead of a result."""

    error: Exception
    traceback: str
    """Its traceback in that process."""


class RemoteBatch:
    """A batch in a spawned process, with the precision and fast_math of this one.

    kind: its class. first: number of its first environment, for messages. options: as of the class.
    """

    def __init__(self, kind: type[Batch], name: str, n: int, *, first: int, **options: Any) -> None:
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
            self.process.join(1.0)
            return BatchError(RobosimError(f"the process of {self.process.name} ended with exit code "
                                           f"{self.process.exitcode}"), "while it handled a request")

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self.process.join(5.0)
        if self.process.is_alive():
            self.process.terminate()
            self.process.join()


def call_batch(batch: Batch, method: str, arguments: tuple) -> Any:
    """Call a method of a batch.

    "describe" returns its observation space, action scaling, actions of an episode and metadata.
    """
    if method == "describe":
        return batch.observation_space, batch.actions, batch.max_episode_steps, batch.metadata
    return getattr(batch, method)(*arguments)


def _serve(pipe: Connection, session: dict[str, Any], kind: type[Batch], name: str, n: int,
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
            result = failure if batch is None else call_batch(batch, method, arguments)
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

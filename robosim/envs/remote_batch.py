"""A batch of environments in a process of its own, called through a pipe."""

import contextlib
import multiprocessing
import traceback
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import mpm
from mpm.backend import numerics
from robosim.envs.batch import GrainBatch
from robosim.errors import RobosimError


class BatchError(NamedTuple):
    """An error that a process returned instead of a result."""

    error: Exception
    traceback: str
    """Its traceback in that process."""


class RemoteBatch:
    """A `GrainBatch` in a spawned process, with the precision and fast_math of this one.

    first: number of its first environment, for messages. options: as of `GrainBatch`.
    """

    def __init__(self, name: str, n: int, *, first: int, **options: Any) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(other_end, numerics(), name, n, options),
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


def call_batch(batch: GrainBatch, method: str, arguments: tuple) -> Any:
    """Call a method of a batch; "describe" returns its observation space, action scaling and actions of an episode."""
    if method == "describe":
        return batch.observation_space, batch.actions, batch.max_episode_steps
    return getattr(batch, method)(*arguments)


def _serve(pipe: Connection, session: dict[str, Any], name: str, n: int, options: dict[str, Any]) -> None:
    """Handle requests until the other end closes; session: arguments of `mpm.init`."""
    try:
        mpm.init(**session)
        batch = GrainBatch(name, n, **options)
    except Exception as error:
        batch, failure = None, BatchError(error, traceback.format_exc())
    else:
        failure = None
    while True:
        try:
            method, arguments = pipe.recv()
        except (EOFError, KeyboardInterrupt):
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

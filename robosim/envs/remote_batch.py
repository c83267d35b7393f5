"""A batch of environments in a process of its own, called through a pipe."""

import contextlib
import multiprocessing
import traceback
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import mpm
from mpm.backend import numerics
from robosim.base.errors import ConfigError, RobosimError
from robosim.envs.batch import EnvBatch, GrainBatch

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

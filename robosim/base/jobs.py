"""Commands in processes of their own, each pinned to a core, so that they do not disturb each other's times.
A command is arguments of `python -m`, and the file that its output is appended to. `run_here` runs them on this
machine; a `Launcher` on others."""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import IO, Any, NamedTuple, Protocol

from filelock import FileLock, Timeout

PR_SET_PDEATHSIG = 1
"""Option of prctl: the signal to get when the parent ends. Source: linux/prctl.h."""
PARENT = "ROBOSIM_PARENT"
"""Environment variable with the id of the process that started a command here."""
SIGNALS = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "SIGHUP"}
"""Signals that interrupt a command, as messages call them."""
POLL = 0.02
"""Time [s] between two looks at the processes."""
LOG_END = 2**16
"""Bytes at the end of a log in which its last line is looked for; progress bars make logs long."""
Command = tuple[list[str], Path]
"""Arguments of `python -m`, and the file that stdout and stderr are appended to."""


class Ended(NamedTuple):
    """How a command ended."""

    index: int
    reason: str
    """Why it failed: the signal, or the end of its output; empty where it succeeded."""


class Launcher(Protocol):
    """Runs commands on other machines."""

    def run(self, commands: Sequence[Command], folder: Path, resumes: bool = True) -> Iterator[Ended]:
        """Submit commands and yield each as it ends.
        folder: of what the cluster writes. resumes: whether a command that is cut off by its time limit continues where
        it stopped; others fail then. Raises ConfigError where they cannot be submitted."""
        ...


def run_here(commands: Sequence[Command], processes: int) -> Generator[Ended, None, None]:
    """Run commands, as many at a time as there are processes, and yield each as it ends.
    Processes that run when the caller leaves are killed."""
    waiting, running = list(enumerate(commands)), {}
    with hold_cores(processes) as cores:
        try:
            while waiting or running:
                for core in cores:
                    if waiting and core not in running:
                        index, command = waiting.pop(0)
                        running[core] = (index, command[1], _start(command, core))
                time.sleep(POLL)
                for core, (index, log, process) in list(running.items()):
                    if process.poll() is not None:
                        del running[core]
                        yield Ended(index, describe_end(process.returncode, log))
        finally:
            for _, _, process in running.values():
                process.kill()
                process.wait()


@contextlib.contextmanager
def hold_cores(count: int) -> Iterator[list[int]]:
    """Choose cores of this process, at most `count`, and hold them: first those that none of this user's programs holds
    here. Two reports at the same time would else be pinned to one core, and take twice as long without a word."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    folder = Path(tempfile.gettempdir()) / f"robosim-cores-{getattr(os, 'getuid', int)()}"
    with contextlib.ExitStack() as stack:
        held = list[int]()
        for core in cores:
            if len(held) < count:
                with contextlib.suppress(Timeout, OSError):  # held by another one; no folder for temporary files
                    folder.mkdir(exist_ok=True)
                    stack.enter_context(FileLock(folder / str(core), timeout=0))
                    held.append(core)
        yield (held + [core for core in cores if core not in held])[:count]


def _start(command: Command, core: int) -> subprocess.Popen:
    arguments, log = command
    with log.open("ab") as output:
        process = subprocess.Popen([sys.executable, "-m", *arguments], stdout=output, stderr=output,
                                   env={**os.environ, "OMP_NUM_THREADS": "1", PARENT: str(os.getpid())})
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(process.pid, {core})  # before it has threads
    return process


def start_command(arguments: Sequence[str], log: IO[Any]) -> subprocess.Popen:
    """Start `robosim` with one thread for arrays; stdout and stderr go to a log.
    A Ctrl-C does not reach it: it is to be ended by SIGTERM, which, unlike SIGINT, the processes of a shell's
    background job do not ignore."""
    return subprocess.Popen([sys.executable, "-m", "robosim", *arguments], stdout=log, stderr=log,
                            env={**os.environ, "OMP_NUM_THREADS": "1"}, start_new_session=True)


def describe_end(code: int, log: Path) -> str:
    """Return why a process failed: the signal that killed it, or the last line of its log; empty for code 0."""
    if code < 0:
        return f"killed by signal {-code}"
    return (read_last_line(log) or f"exit status {code}") if code else ""


def read_last_line(path: Path) -> str:
    """Return the last line of a log that is not empty; "" where there is none."""
    return (read_end(path) or [""])[-1]


def read_end(path: Path) -> list[str]:
    """Return the lines in the last LOG_END bytes of a log that are not empty, each state of a bar as a line."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - LOG_END))
        text = file.read(LOG_END).decode(errors="replace").replace("\r", "\n")
    return [line.strip() for line in text.splitlines() if line.strip()]


@contextlib.contextmanager
def worker_pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Give a pool of `jobs` processes, spawned because a forked one could not use a GPU.
    On an exception, such as Ctrl-C, the workers are stopped at once."""
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=end_with, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        for process in active_children():  # or the pool would wait for the end of their work
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def end_with(parent: int) -> None:
    """Leave interrupts to the parent, and have the kernel kill this process when that ends (Linux only).
    A signal to the group would else end this process first, which the parent would take for a failure. And the
    processes of a killed command would go on: they would disturb times that are measured on their cores, and write to a
    folder whose lock is free."""
    for name in SIGNALS:
        signal.signal(getattr(signal, name, signal.SIGINT), signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before the call above
            raise SystemExit(1)

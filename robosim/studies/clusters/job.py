"""One command as a job of a cluster, which continues where it was cut off."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from robosim.base.jobs import read_end

POLL = 0.2
"""Time [s] between two looks at a command."""
GRACE = 60.0
"""Time [s] that a command has to write its checkpoint after SIGTERM."""
CACHES = {"ROBOSIM_CACHE": "robosim", "MPM_CACHE": "mpm"}
"""Variable of the environment -> folder of a cache: one for each machine, for a home on a network is shared by all."""


class JobFailed(RuntimeError):
    """A command ended with another status than 0; the message has the last lines of its output."""


class ClusterJob:
    """Runs a command in a process of its own.
    Follows submitit's protocol of checkpoints: where its time ends or it is preempted, the command writes its own
    checkpoint and the same job is queued again. It is pickled by reference, so a job needs this package alone."""

    def __init__(self, arguments: list[str], log: Path) -> None:
        self.arguments, self.log, self.folder = arguments, log, Path.cwd()
        self._process: subprocess.Popen[bytes] | None = None

    def __call__(self) -> int:
        """Run to the end and return 0; raises JobFailed."""
        self.log.parent.mkdir(parents=True, exist_ok=True)
        environment = {**os.environ, "OMP_NUM_THREADS": "1", **local_caches()}
        before = signal.signal(signal.SIGUSR2, signal.SIG_IGN)  # SLURM warns every process; the command has SIGTERM
        try:
            with self.log.open("ab") as log:
                self._process = subprocess.Popen([sys.executable, "-m", *self.arguments], stdout=log, stderr=log,
                                                 env=environment, cwd=self.folder)
        finally:
            signal.signal(signal.SIGUSR2, before)
        while not has_ended(self._process.pid):
            time.sleep(POLL)
        status = self._process.wait()
        if status in (-signal.SIGTERM, 128 + signal.SIGTERM):  # from outside, as where its node fails
            time.sleep(GRACE)  # the cluster ends this job, too, and may queue it again: then it has no result yet
        if status:
            raise JobFailed(describe_failure(self.log, status))
        return 0

    def checkpoint(self, *arguments: Any) -> Any:
        """Let the command write its checkpoint; return what is queued again."""
        import submitit.helpers  # pyright: ignore[reportMissingImports]  (of the extra `slurm`)

        if self._process is not None and not has_ended(self._process.pid):
            self._process.terminate()
            end = time.monotonic() + GRACE
            while not has_ended(self._process.pid) and time.monotonic() < end:
                time.sleep(POLL)
        return submitit.helpers.DelayedSubmission(self)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_process": None}


def has_ended(pid: int) -> bool:
    """Return whether a child has ended, without reaping it.
    `Popen.wait` would hold a lock while a handler of a signal, which interrupts it, waits for the same child."""
    try:
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:
        return True


def local_caches() -> dict[str, str]:
    """Return variables that give this machine caches of its own, unless the user chose others."""
    base = Path(os.environ.get("TMPDIR") or "/tmp") / f"robosim-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    return {name: str(base / folder) for name, folder in CACHES.items() if name not in os.environ}


def describe_failure(log: Path, status: int) -> str:
    """Return how a process ended, and the last lines of its log."""
    ended = f"killed by signal {-status}" if status < 0 else f"exit status {status}"
    try:
        return " | ".join([ended, *read_end(log)[-3:]])
    except OSError as error:
        return f"{ended}; {log}: {error.strerror}"

"""Jobs that print their result, on a cluster: for reports of many runs."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from robosim.clusters.job import read_result
from robosim.clusters.launch import Launcher
from robosim.clusters.launchers import make_launcher
from robosim.config.table import read
from robosim.errors import ConfigError
from robosim.reports.jobs import ANY_CORE, Job


class JsonJobs(NamedTuple):
    """Runs jobs by a launcher, as `robosim.reports.jobs.run_jobs` does here."""

    launcher: Launcher
    folder: Path
    """Of what the cluster writes."""

    def __call__(self, jobs: Sequence[Job]) -> Iterator[tuple[int, Any, str]]:
        """Run modules with arguments; yield index, JSON value of the last line, and the reason where there is none."""
        folder = self.folder.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        lines = [[module, *arguments, ANY_CORE] for module, arguments in jobs]
        # named by what is run: a later call finds those of its jobs that are still queued
        commands = [(line, folder / f"{hashlib.sha256(json.dumps(line).encode()).hexdigest()[:12]}.txt")
                    for line in lines]
        for ended in self.launcher.run(commands, folder, resumes=False):
            value = None if ended.reason else read_result(commands[ended.index][1])
            yield ended.index, value, ended.reason or ("" if value is not None else "printed no result")


def make_json_jobs(name: str, table: Path | None, out: Path) -> JsonJobs | None:
    """Return what runs jobs by a launcher's name; None for this machine.

    table: a YAML file with the keys of `LaunchTable`. out: of the command. Raises ConfigError.
    """
    launcher = make_launcher(name)
    if launcher is None:
        if table is not None:
            raise ConfigError(f"--launch-file {table} with --launch local; accepted: with slurm or ray")
        return None
    numbers = {} if table is None else read(table)
    if not isinstance(numbers, dict):
        raise ConfigError(f"{table}: {numbers!r:.60}; accepted: a mapping of the keys of `launch`")
    launcher.configure(numbers)
    return JsonJobs(launcher, out / "launch")

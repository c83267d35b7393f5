"""Jobs that print their result, on a cluster: for reports of many runs."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from robosim.base.digests import code_digest
from robosim.base.errors import ConfigError
from robosim.base.input_files import MAX_JSON, read_text
from robosim.base.jobs import ANY_CORE, Job
from robosim.config.table import read
from robosim.studies.clusters.launch import Launcher
from robosim.studies.clusters.launchers import make_launcher

PRINTED = "robosim.studies.clusters.printed"
MOST_NAME = 4096
"""Characters of a path."""


class JsonJobs(NamedTuple):
    """Runs jobs by a launcher, as `robosim.base.jobs.run_jobs` does here.

    A job is known by its module's code, its arguments and the files that they name: one that ended well while nobody
    waited is not run again, and one that is still queued is waited for.
    """

    launcher: Launcher
    folder: Path
    """Of what the cluster writes, and of the results."""

    def __call__(self, jobs: Sequence[Job]) -> Iterator[tuple[int, Any, str]]:
        """Run modules with arguments; yield index, JSON value of the last line, and the reason where there is none."""
        folder = self.folder.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        results = [folder / f"{identify(module, arguments)}.json" for module, arguments in jobs]
        waiting = [k for k, result in enumerate(results) if not result.is_file()]
        for k in range(len(jobs)):
            if k not in waiting:
                yield k, *read_result(results[k])
        commands = [([PRINTED, str(results[k]), jobs[k][0], *jobs[k][1], ANY_CORE], results[k].with_suffix(".txt"))
                    for k in waiting]
        for ended in self.launcher.run(commands, folder, resumes=False):
            k = waiting[ended.index]
            if ended.reason:
                yield k, None, ended.reason
            else:
                yield k, *read_result(results[k])


def identify(module: str, arguments: Sequence[str]) -> str:
    """Return twelve hexadecimal digits of a job."""
    digest = hashlib.sha256(json.dumps([code_digest(module), module, *arguments]).encode())
    for word in arguments:
        if len(word) < MOST_NAME and Path(word).is_file():
            digest.update(Path(word).read_bytes())
    return digest.hexdigest()[:12]


def read_result(path: Path) -> tuple[Any, str]:
    """Return the JSON value of a file's last line and "", or None and the reason."""
    try:
        return json.loads(read_text(path, MAX_JSON).strip().splitlines()[-1]), ""
    except (OSError, IndexError, ValueError):
        return None, "printed no result"


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

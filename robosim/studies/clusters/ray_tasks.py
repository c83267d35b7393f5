"""Tasks of Ray, for those who have a cluster of it."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError
from robosim.base.jobs import Command, Ended
from robosim.studies.clusters.job import ClusterJob
from robosim.studies.clusters.launch import read_table


class RayLauncher:
    """Runs commands as tasks of the Ray cluster at RAY_ADDRESS, or of this machine. Raises ConfigError without Ray."""

    def __init__(self) -> None:
        try:
            import ray  # pyright: ignore[reportMissingImports]  (of the extra `ray`)
        except ImportError:
            raise ConfigError("--launch ray needs Ray: pip install '.[ray]' in the checkout") from None
        self._ray, self.table = ray, read_table({})

    def configure(self, table: Mapping[str, Any]) -> None:
        """Take over a `launch:` table, of which cores and memory_gb apply; raises ConfigError."""
        self.table = read_table(table)

    def run(self, commands: Sequence[Command], folder: Path, resumes: bool = True) -> Iterator[Ended]:
        """Submit commands and yield each as it ends; a worker that is lost is replaced, and its run continues."""
        ray = self._ray
        if not ray.is_initialized():
            ray.init(log_to_driver=False, include_dashboard=False)
        task = ray.remote(num_cpus=self.table.cores, memory=int(1e9 * self.table.memory_gb), max_retries=3)(run_job)
        pending = {task.remote(ClusterJob(arguments, log)): k for k, (arguments, log) in enumerate(commands)}
        while pending:
            (done, *_), _ = ray.wait(list(pending), num_returns=1)
            index = pending.pop(done)
            try:
                ray.get(done)
                yield Ended(index, "")
            except Exception as error:  # Ray wraps what a task raises, and raises its own for lost workers
                yield Ended(index, str(error).strip().splitlines()[-1])


def run_job(job: ClusterJob) -> int:
    """Run a job; a function, as Ray wants it."""
    return job()

"""Arrays of SLURM jobs, submitted by submitit and queued again where their time ends, and the table `launch:`."""

import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import pydantic
from pydantic import Field

from robosim.base.errors import ConfigError, UnknownName
from robosim.base.files import write_json
from robosim.base.input_files import read_json
from robosim.base.jobs import Command, Ended
from robosim.config.bounds import FilePath, Name
from robosim.config.table import Table, describe, list_errors, read
from robosim.studies.clusters import LAUNCHERS
from robosim.studies.clusters.job import ClusterJob

Line = Annotated[str, Field(max_length=2000)]
UNSEEN = 5
"""Times that the queue lacks a job without a result before it counts as lost."""


class LaunchTable(Table):
    """What a job of a cluster is given."""

    partition: Name = ""
    """Partition of SLURM; empty: the cluster's own choice."""
    account: Name = ""
    qos: Name = ""
    hours: float = Field(24.0, gt=0.0, le=10_000.0)
    """Time limit of a job [h]; one that reaches it is queued again and continues from its checkpoint."""
    memory_gb: float = Field(4.0, gt=0.0, le=100_000.0)
    cores: int = Field(1, ge=1, le=1024)
    """Cores of a job; a run computes on one."""
    parallel: int = Field(256, ge=1, le=100_000)
    """Most jobs that run at the same time."""
    warning_s: int = Field(90, ge=1, le=3600)
    """Time [s] before the limit at which a job is warned to write its checkpoint."""
    setup: Annotated[list[Line], Field(max_length=100)] = []  # noqa: RUF012
    """Lines of shell before the run, such as `module load ...`."""
    python: FilePath = ""
    """Command that starts Python there, such as `apptainer exec lab.sif python`; empty: this one."""
    extra: Annotated[dict[Name, Line | int | float | bool], Field(max_length=100)] = {}  # noqa: RUF012
    """Further options of sbatch, such as constraint: avx512."""


def read_table(table: Mapping[str, Any]) -> LaunchTable:
    """Return a `launch:` table; raises ConfigError for one that is wrong."""
    try:
        return LaunchTable.model_validate(dict(table))
    except pydantic.ValidationError as error:
        raise ConfigError("launch: " + list_errors(error, table, lambda e: describe(e, LaunchTable))) from None


class SlurmLauncher:
    """Submits commands as an array of jobs of one task each. Raises ConfigError where SLURM or submitit is missing."""

    def __init__(self) -> None:
        try:
            import submitit  # pyright: ignore[reportMissingImports]  (of the extra `slurm`)
        except ImportError:
            raise ConfigError("--launch slurm needs submitit: pip install '.[slurm]' in the checkout") from None
        self._submitit, self.table = submitit, read_table({})
        lines = _ask(["sinfo", "-h", "-o", "%P"]).splitlines()
        self._partitions = sorted({line.strip().rstrip("*") for line in lines if line.strip()})

    def configure(self, table: Mapping[str, Any]) -> None:
        """Take over a `launch:` table; raises ConfigError, also for a partition that the cluster does not have."""
        self.table = read_table(table)
        if self.table.partition and self.table.partition not in self._partitions:
            raise ConfigError(f"launch.partition: {self.table.partition!r}; accepted here: "
                              f"{', '.join(self._partitions)}")

    def run(self, commands: Sequence[Command], folder: Path, resumes: bool = True) -> Iterator[Ended]:
        """Submit commands and yield each as it ends; what is interrupted here goes on there."""
        if not commands:
            return
        jobs = self._adopt_or_submit(commands, folder, 1000 if resumes else 0)
        print(f"{len(jobs)} jobs of SLURM: {jobs[0].job_id} to {jobs[-1].job_id}; logs in {folder}; Ctrl-C ends the "
              f"waiting, not the jobs", flush=True)
        waiting, unseen = dict(enumerate(jobs)), dict.fromkeys(range(len(jobs)), 0)
        while waiting:
            queued = list_jobs()
            for index, job in list(waiting.items()):
                has_result = job.paths.result_pickle.exists()
                unseen[index] = 0 if has_result or job.job_id in queued else unseen[index] + 1
                if has_result or unseen[index] > UNSEEN:
                    del waiting[index]
                    yield Ended(index, self._reason(job) if has_result else f"job {job.job_id} is in no queue and left "
                                                                            f"no result; see {job.paths.stderr}")
            if waiting:
                time.sleep(2.0)

    def _adopt_or_submit(self, commands: Sequence[Command], folder: Path, requeues: int) -> list[Any]:
        """Return the jobs of commands: those that an earlier call submitted and that are still queued, and new ones."""
        record = folder / "jobs.json"
        try:
            earlier = read_json(record) if record.is_file() else {}
        except ValueError:  # of no use
            earlier = {}
        queued, jobs = list_jobs(), {}
        for index, (_, log) in enumerate(commands):
            job_id = earlier.get(str(log)) if isinstance(earlier, dict) else None
            if isinstance(job_id, str) and job_id in queued:
                jobs[index] = self._submitit.SlurmJob(folder=folder, job_id=job_id)
        new = [index for index in range(len(commands)) if index not in jobs]
        if new:
            jobs |= dict(zip(new, self._submit([commands[index] for index in new], folder, requeues)))
        write_json(record, {str(log): jobs[index].job_id for index, (_, log) in enumerate(commands)})
        return [jobs[index] for index in range(len(commands))]

    def _submit(self, commands: Sequence[Command], folder: Path, requeues: int) -> list[Any]:
        table = self.table
        folder.mkdir(parents=True, exist_ok=True)
        executor = self._submitit.SlurmExecutor(folder=folder, max_num_timeout=requeues, python=table.python or None)
        named = {key: value for key in ("partition", "account", "qos") if (value := getattr(table, key))}
        executor.update_parameters(
            time=max(1, round(60 * table.hours)), mem=f"{max(1, round(1000 * table.memory_gb))}M",
            cpus_per_task=table.cores, ntasks_per_node=1, nodes=1, array_parallelism=table.parallel,
            signal_delay_s=table.warning_s, job_name="robosim", setup=list(table.setup),
            additional_parameters={"requeue": True, **table.extra}, **named)
        try:
            return executor.submit_array([ClusterJob(arguments, log) for arguments, log in commands])
        except Exception as error:  # submitit raises its own and subprocess's errors
            raise ConfigError(f"sbatch refused the jobs: {error}") from None

    @staticmethod
    def _reason(job: Any) -> str:
        error = job.exception()
        if error is None:
            return ""
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        own = [line.split("JobFailed: ", 1)[1] for line in lines if "JobFailed: " in line]
        return own[-1] if own else f"{lines[-1]}; see {job.paths.stderr}"


def list_jobs() -> set[str]:
    """Return the ids of the user's jobs that wait, run or have just ended, arrays by element."""
    return set(_ask(["squeue", "--me", "-h", "-r", "-o", "%i %A"]).split())


def _ask(words: list[str]) -> str:
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=60.0)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigError(f"--launch slurm: {words[0]}: {error}; accepted: on a machine that submits to SLURM (Debian: "
                          f"apt install slurm-client)") from None
    if done.returncode:
        raise ConfigError(f"--launch slurm: {words[0]}: {done.stderr.strip() or f'status {done.returncode}'}")
    return done.stdout


def make_launcher(name: str) -> SlurmLauncher | None:
    """Return the launcher of a name; None for processes of this machine. Raises ConfigError, UnknownName."""
    if name not in LAUNCHERS:
        raise UnknownName("launcher", name, LAUNCHERS)
    return None if name == "local" else SlurmLauncher()


def find_launcher(name: str, table: Path | None) -> SlurmLauncher | None:
    """Return the launcher of a name with what a YAML file says, which has the keys of `LaunchTable`.
    Raises ConfigError, UnknownName."""
    if name == "local":
        if table is not None:
            raise ConfigError(f"--launch-file {table} with --launch local; accepted: with --launch slurm")
        return None
    numbers = {} if table is None else read(table)
    if not isinstance(numbers, dict):
        raise ConfigError(f"{table}: {numbers!r:.60}; accepted: a mapping of the keys of `launch`")
    read_table(numbers)  # what the file has wrong is said first, also where there is no cluster
    launcher = make_launcher(name)
    if launcher is not None:
        launcher.configure(numbers)
    return launcher

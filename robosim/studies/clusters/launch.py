"""Commands that are run elsewhere, and what a `launch:` table says about them."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol

import pydantic
from pydantic import Field

from robosim.base.errors import ConfigError
from robosim.config.bounds import FilePath, Name
from robosim.config.table import Table, describe, list_errors

Line = Annotated[str, Field(max_length=2000)]


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


class Ended(NamedTuple):
    """How a command ended."""

    index: int
    reason: str
    """Last lines of its output, and the status; empty where it succeeded."""


class Launcher(Protocol):
    """Runs commands on other machines."""

    def configure(self, table: Mapping[str, Any]) -> None:
        """Take over a `launch:` table; raises ConfigError."""

    def run(self, commands: Sequence[tuple[list[str], Path]], folder: Path,
            resumes: bool = True) -> Iterator[Ended]:
        """Submit commands, arguments of `python -m` each, and yield each as it ends.

        The second part of a command is the file that its output is appended to. folder: of what the cluster writes.
        resumes: whether a command that is cut off by its time limit continues where it stopped; others fail then.

        Raises ConfigError where they cannot be submitted.
        """
        ...


def read_table(table: Mapping[str, Any]) -> LaunchTable:
    """Return a `launch:` table; raises ConfigError for one that is wrong."""
    try:
        return LaunchTable.model_validate(dict(table))
    except pydantic.ValidationError as error:
        raise ConfigError("launch: " + list_errors([describe(e, LaunchTable) for e in error.errors()])) from None

"""The `launch:` table: what a job of a cluster is given."""

from collections.abc import Mapping
from typing import Annotated, Any

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


def read_table(table: Mapping[str, Any]) -> LaunchTable:
    """Return a `launch:` table; raises ConfigError for one that is wrong."""
    try:
        return LaunchTable.model_validate(dict(table))
    except pydantic.ValidationError as error:
        raise ConfigError("launch: " + list_errors(error, table, lambda e: describe(e, LaunchTable))) from None

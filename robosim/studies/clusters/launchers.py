"""The launcher of a name."""

from pathlib import Path

from robosim.base.errors import ConfigError, UnknownName
from robosim.config.table import read
from robosim.studies.clusters import LAUNCHERS
from robosim.studies.clusters.launch import ClusterLauncher, read_table


def make_launcher(name: str) -> ClusterLauncher | None:
    """Return the launcher of a name; None for processes of this machine. Raises ConfigError, UnknownName."""
    if name not in LAUNCHERS:
        raise UnknownName("launcher", name, LAUNCHERS)
    if name == "local":
        return None
    from robosim.studies.clusters.slurm import SlurmLauncher

    return SlurmLauncher()


def find_launcher(name: str, table: Path | None) -> ClusterLauncher | None:
    """Return the launcher of a name with what a YAML file says, which has the keys of `LaunchTable`.

    Raises ConfigError, UnknownName.
    """
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

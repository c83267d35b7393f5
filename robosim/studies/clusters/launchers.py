"""The launcher of a name."""

from robosim.base.errors import UnknownName
from robosim.studies.clusters import LAUNCHERS
from robosim.studies.clusters.launch import Launcher


def make_launcher(name: str) -> Launcher | None:
    """Return the launcher of a name; None for processes of this machine. Raises ConfigError, UnknownName."""
    if name not in LAUNCHERS:
        raise UnknownName("launcher", name, LAUNCHERS)
    if name == "local":
        return None
    if name == "slurm":
        from robosim.studies.clusters.slurm import SlurmLauncher

        return SlurmLauncher()
    from robosim.studies.clusters.ray_tasks import RayLauncher

    return RayLauncher()

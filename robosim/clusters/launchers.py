"""The launcher of a name."""

from robosim.clusters import LAUNCHERS
from robosim.clusters.launch import Launcher
from robosim.errors import UnknownName


def make_launcher(name: str) -> Launcher | None:
    """Return the launcher of a name; None for processes of this machine. Raises ConfigError, UnknownName."""
    if name not in LAUNCHERS:
        raise UnknownName("launcher", name, LAUNCHERS)
    if name == "local":
        return None
    if name == "slurm":
        from robosim.clusters.slurm import SlurmLauncher

        return SlurmLauncher()
    from robosim.clusters.ray_tasks import RayLauncher

    return RayLauncher()

"""Where configs/ and models/ lie: inside an installed wheel, or beside the package in a checkout."""

from importlib.resources import files
from pathlib import Path

from robosim.errors import ConfigError, UnknownName

CHECKOUT = Path(__file__).resolve().parents[2]
"""Folder of the packages: the repository, or site-packages."""


def folder(name: str) -> Path:
    """Folder "configs" or "models"."""
    installed = Path(str(files("robosim"))) / name
    return installed if installed.is_dir() else CHECKOUT / name


def trained(task: str) -> Path | None:
    """Return the path of the bundled motion of a sub-task; None where there is none."""
    path = CHECKOUT / "policies" / "trained" / f"{task}.npz"
    return path if path.is_file() else None


def trained_network(task: str) -> Path | None:
    """Return the path of the bundled network of a sub-task, a policy that observes; None where there is none."""
    path = CHECKOUT / "policies" / "trained" / "networks" / f"{task}.npz"
    return path if path.is_file() else None


def config_names(kind: str) -> list[str]:
    """Stems of configs/<kind>/*.yaml, sorted."""
    return sorted(path.stem for path in (folder("configs") / kind).glob("*.yaml"))


def container_names() -> list[str]:
    """Stems of models/containers/*.xml, sorted."""
    return sorted(path.stem for path in (folder("models") / "containers").glob("*.xml"))


def tool_names() -> list[str]:
    """Names of the tools of models/tools, sorted."""
    return sorted(path.parent.name for path in (folder("models") / "tools").glob("*/*.xml"))


def part_names(kind: str) -> list[str]:
    """Names of the folders of models/<kind> with a .yaml file: arms of robots, hands of grippers."""
    return sorted({path.parent.name for path in (folder("models") / kind).glob("*/*.yaml")})


def config_path(kind: str, name: str, what: str) -> Path:
    """Path of configs/<kind>/<name>.yaml, or of a user's own file when `name` ends in .yaml."""
    if name.endswith((".yaml", ".yml")) and Path(name).is_file():
        return Path(name)
    if name.endswith((".yaml", ".yml")):
        raise ConfigError(f"{what} {name}: no such file; accepted: a .yaml file of your own, or one of "
                          f"{', '.join(config_names(kind))}")
    if name not in config_names(kind):
        raise UnknownName(what, name, config_names(kind), "or the path of a .yaml file of your own")
    return folder("configs") / kind / f"{name}.yaml"

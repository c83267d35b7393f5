"""Where configs/ and models/ lie: inside an installed wheel, or beside the package in a checkout."""

import contextlib
from importlib.resources import files
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError, UnknownName

CHECKOUT = Path(__file__).resolve().parents[2]
"""Folder of the packages: the repository, or site-packages."""
PATH_KEYS = ("material", "motions", "robot", "gripper", "tool", "model", "mesh", "workcell", "controllers",
             "inner_face")
"""Keys of files whose values may be paths."""
SUFFIXES = (".yaml", ".yml", ".xml", ".mjcf", ".urdf", ".stl", ".obj", ".ply", ".glb")
"""Ends of values that are paths, not names."""


def folder(name: str) -> Path:
    """Folder "configs" or "models"."""
    installed = Path(str(files("robosim"))) / name
    return installed if installed.is_dir() else CHECKOUT / name


def trained(task: str, kind: str = ".") -> Path | None:
    """Return the path of the bundled motion of a sub-task, of its policy in "networks" or "students"; or None."""
    path = CHECKOUT / "policies" / "trained" / kind / f"{task}.npz"
    return path if path.is_file() else None


def config_names(kind: str) -> list[str]:
    """Stems of configs/<kind>/*.yaml, sorted."""
    return sorted(path.stem for path in (folder("configs") / kind).glob("*.yaml"))


def part_names(kind: str) -> list[str]:
    """Names of the folders of models/<kind> with a .yaml file: arms of robots, hands of grippers, tools."""
    return sorted({path.parent.name for path in (folder("models") / kind).glob("*/*.yaml")})


def config_path(kind: str, name: str, what: str) -> Path:
    """Return the path of configs/<kind>/<name>.yaml, or of a user's own file when `name` ends in .yaml.
    Raises ConfigError, UnknownName."""
    return own_file(name, what, config_names(kind)) or folder("configs") / kind / f"{name}.yaml"


def part_path(kind: str, name: str, what: str, *others: str) -> Path:
    """Return the .yaml file of models/<kind>/<name>, or of a user's own; others: names that are no files."""
    return own_file(name, what, [*part_names(kind), *others]) or next((folder("models") / kind / name).glob("*.yaml"))


def own_file(name: str, what: str, accepted: list[str]) -> Path | None:
    """Return the path of a user's own file when `name` ends in .yaml, else None; raises ConfigError, UnknownName."""
    if isinstance(name, str) and name.endswith((".yaml", ".yml")):
        with contextlib.suppress(OSError):  # a name that is too long
            if Path(name).is_file():
                return Path(name)
        raise ConfigError(f"{what} {name:.200}: no such file; accepted: a .yaml file of your own, or one of "
                          f"{', '.join(accepted)}")
    if name not in accepted:
        made = ", which `robosim new arm MODEL` writes" if what in ("arm", "robot") else ""
        raise UnknownName(what, name, accepted, f"or the path of a .yaml file of your own{made}")
    return None


def locate_paths(value: Any, place: Path, is_paths: bool = False) -> Any:
    """Return a file's content with its paths made absolute, or all its texts; place: what they are relative to."""
    if isinstance(value, dict):
        return {key: str((place / item).resolve()) if _is_path(key, item) or (is_paths and isinstance(item, str)) else
                locate_paths(item, place, key == "packages") for key, item in value.items()}
    return [locate_paths(item, place) for item in value] if isinstance(value, list) else value


def _is_path(key: Any, value: Any) -> bool:
    return key in PATH_KEYS and isinstance(value, str) and (value.lower().endswith(SUFFIXES) or key == "motions")

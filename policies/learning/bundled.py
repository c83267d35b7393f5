"""Names of the bundled configuration files, found without reading them."""

from pathlib import Path

import mpm


def configs_folder() -> Path:
    """Folder configs/, beside the packages in a checkout and inside robosim in a wheel."""
    top = Path(__file__).resolve().parents[2]
    inside = top / "robosim" / "configs"
    return inside if inside.is_dir() else top / "configs"


def bundled_names(kind: str) -> list[str]:
    """Names of configs/<kind>/*.yaml, sorted; kind: "tasks", "training", "materials" or "rehearsals"."""
    return sorted(path.stem for path in (configs_folder() / kind).glob("*.yaml"))


def check_method(name: str) -> Path:
    """Find the file of a method, by name or path; raises mpm.InvalidValue for one that does not exist."""
    path = Path(name) if name.endswith((".yaml", ".yml")) else configs_folder() / "training" / f"{name}.yaml"
    if not path.is_file():
        raise mpm.InvalidValue(f"method {name!r}; accepted: {', '.join(bundled_names('training'))}, or the path of a "
                               f".yaml file")
    return path


def check_task(name: str, also: str = "") -> None:
    """Raise mpm.InvalidValue unless a task is a sub-task's name or the path of a .yaml file."""
    if name.endswith((".yaml", ".yml")):
        if not Path(name).is_file():
            raise mpm.InvalidValue(f"task {name}: no such file")
    elif name.split("/")[-1].split("-v")[0] not in bundled_names("tasks"):
        raise mpm.InvalidValue(f"task {name!r}; accepted: {', '.join(bundled_names('tasks'))}, or a task's .yaml "
                               f"file{also}")


def check_material(name: str | None) -> None:
    """Raise mpm.InvalidValue unless a material is None, a name, or the path of a .yaml file."""
    if name is not None and not name.endswith((".yaml", ".yml")) and name not in bundled_names("materials"):
        raise mpm.InvalidValue(f"material {name!r}; accepted: {', '.join(bundled_names('materials'))}, or the path of "
                               f"a .yaml file")

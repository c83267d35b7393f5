"""What is installed: names of the bundled configuration files, listed without reading them, and the extra `learn`."""

from importlib.util import find_spec
from pathlib import Path

import mpm

NEEDED = ("torch", "stable_baselines3", "sb3_contrib", "tensorboard", "cma")
"""Modules of the extra `learn`."""


def configs_folder() -> Path:
    """Return the folder configs/: next to the packages in a checkout, inside robosim in a wheel."""
    top = Path(__file__).resolve().parents[2]
    installed = top / "robosim" / "configs"
    return installed if installed.is_dir() else top / "configs"


def bundled_names(kind: str) -> list[str]:
    """Return the names of configs/<kind>/*.yaml, sorted; kind: "tasks", "training", "materials" or "rehearsals"."""
    return sorted(path.stem for path in (configs_folder() / kind).glob("*.yaml"))


def is_task_file(task: str) -> bool:
    """Return whether a task is given as the path of a .yaml file, not as a name."""
    return task.endswith((".yaml", ".yml"))


def task_name(task: str) -> str:
    """Return a sub-task's name, given as such or as its id ("robosim/SpoonPour-v0")."""
    return task.split("/")[-1].split("-v")[0]


def is_unknown_task(task: str) -> bool:
    """Return whether a task is no bundled sub-task, no existing file and no Gymnasium id such as Pendulum-v1."""
    return not Path(task).is_file() if is_task_file(task) else "-v" not in task and task not in bundled_names("tasks")


def check_method(name: str) -> Path:
    """Return the file of a method, given by name or path; raises mpm.InvalidValue for one that does not exist."""
    path = Path(name) if name.endswith((".yaml", ".yml")) else configs_folder() / "training" / f"{name}.yaml"
    if not path.is_file():
        raise mpm.InvalidValue(f"method {name!r}; accepted: {', '.join(bundled_names('training'))}, or the path of a "
                               f".yaml file")
    return path


def check_task(name: str, also: str = "") -> None:
    """Raise mpm.InvalidValue unless a task is a sub-task's name or the path of a .yaml file."""
    if is_task_file(name):
        if not Path(name).is_file():
            raise mpm.InvalidValue(f"task {name}: no such file")
    elif task_name(name) not in bundled_names("tasks"):
        raise mpm.InvalidValue(f"task {name!r}; accepted: {', '.join(bundled_names('tasks'))}, or a task's .yaml "
                               f"file{also}")


def check_material(name: str | None) -> None:
    """Raise mpm.InvalidValue unless a material is None, a name, or the path of a .yaml file."""
    if name is not None and not name.endswith((".yaml", ".yml")) and name not in bundled_names("materials"):
        raise mpm.InvalidValue(f"material {name!r}; accepted: {', '.join(bundled_names('materials'))}, or the path of "
                               f"a .yaml file")


def check_installed() -> None:
    """Raise mpm.InvalidValue where a module is missing."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise mpm.InvalidValue(f"learning needs {', '.join(missing)}: pip install '.[learn]' in the checkout")

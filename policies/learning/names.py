"""Names that commands are given, checked before anything heavy is loaded, and the extra `learn`."""

from importlib.util import find_spec

import mpm
from robosim.base.errors import UnknownName
from robosim.base.resources import config_path


def is_task_file(task: str) -> bool:
    """Return whether a task is given as the path of a .yaml file, not as a name."""
    return task.endswith((".yaml", ".yml"))


def task_name(task: str) -> str:
    """Return a sub-task's name, given as such or as its id ("robosim/SpoonPour-v0")."""
    return task.split("/")[-1].split("-v")[0] if not is_task_file(task) else task


def is_foreign(task: str) -> bool:
    """Return whether a task is given by an id of Gymnasium such as Pendulum-v1 that is none of robosim's."""
    return "-v" in task and not task.startswith("robosim") and not is_task_file(task)


def check_task(task: str) -> None:
    """Raise robosim.ConfigError unless a task is a bundled sub-task's name or id, or an existing .yaml file."""
    config_path("tasks", task_name(task), "task")


def check_trainable(task: str) -> None:
    """Raise robosim.ConfigError unless a task is robosim's, as in `check_task`, or an id of Gymnasium."""
    try:
        if not is_foreign(task):
            check_task(task)
    except UnknownName as error:
        raise UnknownName("task", task, error.valid, "the path of a .yaml file of your own, or an id of Gymnasium such "
                          "as Pendulum-v1") from None


def check_installed() -> None:
    """Raise mpm.InvalidValue where a module of the extra `learn` is missing."""
    needed = ("torch", "stable_baselines3", "sb3_contrib", "tensorboard", "cma")
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        raise mpm.InvalidValue(f"learning needs {', '.join(missing)}: pip install '.[learn]' in the checkout")

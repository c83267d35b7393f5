"""Gymnasium environments of the eight sub-tasks and of tasks in files; `import robosim` registers them.

Imports: config, coupling, errors, rendering, robot, scene, shapes, tasks, mpm.
"""

from functools import partial
from pathlib import Path
from typing import Any

import gymnasium

from robosim.errors import UnknownName

TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour",
         "ShovelMove")


def register() -> None:
    """Make the ids robosim/<task>-v0 known, and robosim/Task-v0 for a file of one (`task=`); nothing is imported or
    built before `gymnasium.make`."""
    for name in TASKS:
        gymnasium.register(f"robosim/{name}-v0", entry_point=f"robosim.envs.sub_tasks:{name}",
                           vector_entry_point=partial(_vector, name))
    gymnasium.register("robosim/Task-v0", entry_point="robosim.envs.grain_env:GrainEnv",
                       vector_entry_point=partial(_vector, "Task"))


def in_file(task: str) -> bool:
    """Whether a task is a file of its own; raises UnknownName where it is no sub-task either."""
    if task in TASKS:
        return False
    if not task.endswith((".yaml", ".yml")):
        raise UnknownName("task", task, TASKS, "or a task's .yaml file")
    return True


def make(task: str, **options: Any) -> gymnasium.Env:
    """The environment of a sub-task, by name, or of a task's file; options as of `robosim.envs.grain_env.GrainEnv`.
    Raises UnknownName, and ConfigError for a file that cannot be used."""
    if in_file(task):
        return gymnasium.make("robosim/Task-v0", task=task, **options)
    return gymnasium.make(f"robosim/{task}-v0", **options)


def task_name(task: str) -> str:
    """What files call a task: a sub-task's name, or that of its file without folder and ending."""
    return Path(task).stem


def _vector(name: str, **options: Any) -> gymnasium.vector.VectorEnv:
    """Several environments of one sub-task."""
    from robosim.envs.vector import make_vector

    return make_vector(name, **options)

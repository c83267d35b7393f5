"""Gymnasium environments of the sub-tasks, of dosing and of task files; `import robosim` registers them.

Imports: base, cell, config, coupling, dosing, randomization, rendering, rewards, robot, scene, senses, shapes, tasks,
mpm."""

import sys
from collections.abc import Sequence
from functools import partial
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from robosim.base.errors import UnknownName

if TYPE_CHECKING:
    import gymnasium

TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour",
         "ShovelMove")
"""The eight sub-tasks of arXiv 2406.09178."""
DOSING = ("DoseSpoon", "DoseScoop", "DoseBottle", "DoseShaker", "ScoopTo")
"""Tasks of dosing."""
BUNDLED = (*TASKS, *DOSING)
"""All tasks of configs/tasks."""


def register_with_gymnasium() -> None:
    """Register the ids now if Gymnasium is imported, otherwise at the end of its import."""
    if "gymnasium" in sys.modules:
        register()
    else:
        sys.meta_path.insert(0, RegistersAfterImport())


def register() -> None:
    """Register robosim/<task>-v0 and, for task files, robosim/Task-v0, of which nothing is imported before `make`."""
    import gymnasium

    for name in BUNDLED:
        gymnasium.register(f"robosim/{name}-v0", entry_point=f"robosim.envs.sub_tasks:{name}",
                           vector_entry_point=partial(_make_vector, name))
    gymnasium.register("robosim/Task-v0", entry_point="robosim.envs.grain_env:GrainEnv",
                       vector_entry_point=partial(_make_vector, "Task"))


class RegistersAfterImport:
    """An import hook that registers the ids once Gymnasium's own import is done.
    Gymnasium 1.x has no entry points for plugins, and its import takes longer than all else that `--help` needs."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None,
                  ) -> ModuleSpec | None:
        """Give Gymnasium's own spec, with its loader followed by `register`; None for any other module."""
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is None or spec.loader is None:
            return None
        load = spec.loader.exec_module

        def load_and_register(module: ModuleType) -> None:
            load(module)
            register()

        spec.loader.exec_module = load_and_register
        return spec


def is_task_file(task: str) -> bool:
    """Return whether a task is a task file's path, or else a sub-task's name; raises UnknownName for neither."""
    if task in BUNDLED:
        return False
    if not task.endswith((".yaml", ".yml")):
        raise UnknownName("task", task, BUNDLED, "or a task's .yaml file")
    return True


def make(name: str, /, **options: Any) -> "gymnasium.Env":
    """Make the environment of a sub-task, by name, or of a task file; options as of `robosim.envs.grain_env.GrainEnv`.
    Raises UnknownName for what is neither, ConfigError for a file that cannot be used."""
    import gymnasium

    if is_task_file(name):
        return gymnasium.make("robosim/Task-v0", **{"task": name, **options})
    return gymnasium.make(f"robosim/{name}-v0", **options)


def task_name(task: str) -> str:
    """Return a sub-task's name, or a task file's name without folder and extension."""
    return Path(task).stem


def _make_vector(name: str, **options: Any) -> "gymnasium.vector.VectorEnv":
    from robosim.envs.vector import make_vector

    return make_vector(name, **options)

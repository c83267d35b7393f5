"""Environments by task name: policies use robosim through Gymnasium's registry alone."""

from typing import Any

import gymnasium

import mpm
from policies.learning.bundled import check_task, is_task_file
from policies.learning.files import digest


def make_environment(task: str, **options: Any) -> gymnasium.Env:
    """Make the environment of a bundled sub-task ("SpoonPour") or of a task's .yaml file.

    options: keyword arguments of `robosim.envs.grain_env.GrainEnv`; material=None is the task's own material.

    Raises:
        mpm.InvalidValue: the task does not exist, or an option does not fit it.
    """
    given = {key: value for key, value in options.items() if key != "material" or value is not None}
    if is_task_file(task):
        return gymnasium.make("robosim:robosim/Task-v0", task=task, **given)
    name = task.split("/")[-1].split("-v")[0]
    check_task(task, "; for training also an id of Gymnasium such as Pendulum-v1")
    try:
        return gymnasium.make(f"robosim:robosim/{name}-v0", **given)
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error


def make_training_environment(task: str, obs: str, action_repeat: int, **options: Any) -> gymnasium.Env:
    """Make the environment of a sub-task, or the one that Gymnasium registers under another id ("Pendulum-v1").

    obs and action_repeat apply to robosim's environments only. Raises mpm.InvalidValue as `make_environment` does.
    """
    if "-v" not in task or task.startswith("robosim") or is_task_file(task):
        return make_environment(task, obs=obs, action_repeat=action_repeat, **options)
    try:
        return gymnasium.make(task)
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error


def fingerprint(env: Any, *settings: object) -> str:
    """Return a digest of an environment's task and material, and of any other settings."""
    return digest([env.task.model_dump(), env.material.model_dump(), *settings])

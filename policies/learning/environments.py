"""The environments that learning happens in, by name: policies know robosim through gymnasium alone."""

from typing import Any

import gymnasium

import mpm
from policies.learning.bundled import check_task
from policies.learning.presets import in_file


def made(task: str, **options: Any) -> gymnasium.Env:
    """The environment of a sub-task ("SpoonPour"), or of a task's .yaml file; raises mpm.InvalidValue for one that does
    not exist. options: see `robosim.envs.grain_env.GrainEnv`; None for the task's own material."""
    given = {key: value for key, value in options.items() if key != "material" or value is not None}
    if in_file(task):
        return gymnasium.make("robosim:robosim/Task-v0", task=task, **given)
    name = task.split("/")[-1].split("-v")[0]
    check_task(task, "; for training also an id of Gymnasium such as Pendulum-v1")
    try:
        return gymnasium.make(f"robosim:robosim/{name}-v0", **given)
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error


def any_made(task: str, obs: str, hold: int, **options: Any) -> gymnasium.Env:
    """The same, or, for an id with a version that is not ours ("Pendulum-v1"), what Gymnasium has under it."""
    if "-v" not in task or task.startswith("robosim") or in_file(task):
        return made(task, obs=obs, action_repeat=hold, **options)
    try:
        return gymnasium.make(task)
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error

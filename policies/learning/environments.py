"""Environments by task name, their digests, and the score of a motion in one."""

from typing import Any

import gymnasium
import numpy as np

import mpm
from policies.learning.names import check_task, is_foreign, is_task_file, task_name
from robosim.base.digests import digest
from robosim.episode.play import play, read_scores


def make_environment(task: str, **options: Any) -> gymnasium.Env:
    """Make the environment of a bundled sub-task ("SpoonPour") or of a task's .yaml file.

    options: keyword arguments of `robosim.envs.grain_env.GrainEnv`; material=None is the task's own material.

    Raises:
        mpm.InvalidValue: the task does not exist, or an option does not fit it.
    """
    given = {key: value for key, value in options.items() if key != "material" or value is not None}
    if is_task_file(task):
        return gymnasium.make("robosim:robosim/Task-v0", task=task, **given)
    check_task(task)
    try:
        return gymnasium.make(f"robosim:robosim/{task_name(task)}-v0", **given)
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error


def make_vector_environment(task: str, n: int, **options: Any) -> Any:
    """Make n environments of a sub-task that this process simulates together, as `make_environment` makes one.

    Raises:
        mpm.InvalidValue: the task is none of robosim's.
    """
    if is_task_file(task):
        return gymnasium.make_vec("robosim:robosim/Task-v0", num_envs=n, workers=1, task=task, **options)
    check_task(task)
    return gymnasium.make_vec(f"robosim:robosim/{task_name(task)}-v0", num_envs=n, workers=1, **options)


def make_training_environment(task: str, obs: str, action_repeat: int, **options: Any) -> gymnasium.Env:
    """Make the environment of a sub-task, or the one that Gymnasium registers under another id ("Pendulum-v1").

    obs and action_repeat apply to robosim's environments only. Raises mpm.InvalidValue as `make_environment` does.
    """
    if not is_foreign(task):
        return make_environment(task, obs=obs, action_repeat=action_repeat, **options)
    try:
        return gymnasium.make(task)
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error


def fingerprint(env: Any, *settings: object) -> str:
    """Return a digest of an environment's task and material, without their descriptions, and of any other settings."""
    return digest([env.task.model_dump(exclude={"description"}), env.material.model_dump(exclude={"description"}),
                   *settings])


def task_digest(env: Any) -> str:
    """Return a digest of an environment's task, without its description."""
    return digest(env.task.model_dump(exclude={"description"}))


def field_digest(env: Any) -> str:
    """Return a digest of an environment's field: its settings, its material and what the solver makes of them."""
    solver = env.solver
    return digest([env.task.field.model_dump(), env.material.model_dump(exclude={"description"}), solver.dt,
                   solver.precision, solver.numerics.integrator, solver.transfer_interval, solver.sleep])


def score_motion(env: gymnasium.Env, actions: np.ndarray, *, seed: int | None = None,
                 options: dict[str, Any] | None = None) -> dict[str, float]:
    """Return score, success and readings of a sub-task's episode with actions (decisions, dimensions)."""
    return read_scores(play(env, np.asarray(actions, np.float32), seed=seed, options=options)[1])

"""Environments by task name, their digests, and the score of a motion in one."""

from typing import Any

import gymnasium
import numpy as np

import mpm
from policies.learning.names import check_task, is_foreign, is_task_file, task_name
from robosim.base.digests import digest
from robosim.episode.play import play, read_scores
from robosim.senses.perception import observation_options


def environment_id(task: str) -> tuple[str, dict[str, str]]:
    """Return the id in Gymnasium of a bundled sub-task ("SpoonPour") or of a task's .yaml file, and its own options.
    Raises robosim.ConfigError where the task does not exist."""
    check_task(task)
    return ("robosim/Task-v0", {"task": task}) if is_task_file(task) else (f"robosim/{task_name(task)}-v0", {})


def make_environment(task: str, **options: Any) -> gymnasium.Env:
    """Make the environment of a bundled sub-task or of a task's .yaml file.
    options: keyword arguments of `robosim.envs.grain_env.GrainEnv`; material=None is the task's own material. Raises
    robosim.ConfigError for a task that does not exist, mpm.InvalidValue for an option that does not fit it."""
    name, own = environment_id(task)
    given = {key: value for key, value in options.items() if key != "material" or value is not None}
    return _make(task, f"robosim:{name}", **own, **given)


def make_training_environment(task: str, obs: str, action_repeat: int, **options: Any) -> gymnasium.Env:
    """Make the environment of a sub-task, or the one that Gymnasium registers under another id ("Pendulum-v1").
    obs, action_repeat and options apply to robosim's environments only. Raises as `make_environment` does."""
    return _make(task, task) if is_foreign(task) else \
        make_environment(task, **observation_options(obs), action_repeat=action_repeat, **options)


def _make(task: str, name: str, /, **options: Any) -> gymnasium.Env:
    try:
        return gymnasium.make(name, **options)
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error


def make_vector_environment(task: str, n: int, **options: Any) -> Any:
    """Make n environments of a sub-task that this process simulates together; raises robosim.ConfigError for none."""
    name, own = environment_id(task)
    return gymnasium.make_vec(f"robosim:{name}", num_envs=n, workers=1, **own, **options)


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


def score_motion(env: gymnasium.Env, actions: np.ndarray, **reset: Any) -> dict[str, float]:
    """Return score, success and readings of a sub-task's episode with actions (decisions, dimensions).
    reset: seed and options of the reset."""
    return read_scores(play(env, np.asarray(actions, np.float32), **reset)[1])

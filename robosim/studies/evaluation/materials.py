"""`robosim materials`: one motion of each sub-task in materials that it was not recorded in."""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from mpm.array_files import MAX_ARRAYS
from robosim.base.digests import digest
from robosim.base.errors import ConfigError
from robosim.base.files import write_rows
from robosim.base.input_files import read_bytes
from robosim.base.jobs import Launcher
from robosim.base.output_folder import OutputFolder, aligned
from robosim.base.study import Job, Study
from robosim.config.materials import load_material
from robosim.dosing import CONTROLLERS
from robosim.envs import is_task_file, make, task_name
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import Transition, play
from robosim.randomization.materials import MATERIALS
from robosim.studies.evaluation.page import make_materials_page
from robosim.studies.policies import POLICIES, check_policy
from robosim.studies.policies.make import bundled_motion, load_policy, make_policy, training_options
from robosim.studies.policies.tool_view import numbers_of
from robosim.tasks.task import load_task

READINGS = ("delivered", "spilled", "collisions")
OWN = "the task's own"
"""Label of the task's own material, from which the trajectory's deviation is measured."""
Rows = dict[str, dict[str, Any]]
"""Label of a material -> score, deviation and readings in it."""


def materials(tasks: list[str], out: Path, *, name: str = "recorded", jobs: int = 1,
              launcher: Launcher | None = None) -> int:
    """Run a policy's motion of every task in all materials, and write tables and a page into a folder.
    Episodes that the folder already has, of the same motion, task and code, are not run again. jobs: processes, here;
    launcher: runs the episodes elsewhere. Returns 0, or 1 where a process failed; the same command then continues.
    Raises UnknownName for a task that does not exist, ConfigError for a motion that does not fit."""
    tasks = list(dict.fromkeys(tasks))
    for task in tasks:
        is_task_file(task)  # raises for a task that does not exist
        check_motion(task, name)
    if len({task_name(task) for task in tasks}) < len(tasks):
        raise ConfigError(f"tasks {', '.join(tasks)}: two have the same name; accepted: files of different names")
    work = [Job("robosim.studies.evaluation.materials:play_in_material",
                {"task": task, "name": name, "label": label}, depends=inputs)
            for task in tasks for inputs in [list_inputs(task, name)] for label in [OWN, *MATERIALS]]
    episodes = dict[str, Rows]()
    with OutputFolder(out) as folder:
        for row in Study(folder.path, jobs, launcher).rows(work, "materials", "episodes"):
            task, label = row.job.arguments["task"], row.job.arguments["label"]
            if row.failed:
                folder.failures.append(f"{task} in {label}: {row.failed}")
            else:
                episodes.setdefault(task, {})[label] = row.value
        complete = [task for task in tasks if len(episodes.get(task, {})) == 1 + len(MATERIALS)]
        if complete:
            write_tables(folder, name, {task_name(task): make_rows(episodes[task]) for task in complete})
    for failure in folder.failures:
        print(f"failed: {failure}; finished episodes are kept, run the same command again to continue", file=sys.stderr)
    return int(bool(folder.failures))


def check_motion(task: str, name: str) -> None:
    """Raise UnknownName for a policy that does not exist, ConfigError for one that does not fit a task.
    ConfigError, too, for a dosing task: it delivers a mass and no share of the grains."""
    if load_task(task).dose is not None:
        raise ConfigError(f"{task}: a dosing task delivers no share of its grains; accepted: a task without a section "
                          f"dose; robosim evaluate {task} --material NAME evaluates a dose in another material")
    if name in POLICIES:
        if name == "recorded":
            bundled_motion(task_name(task))  # raises where there is none
        if name in CONTROLLERS:
            numbers_of(load_task(task), f"policy {name!r}")
        return
    check_policy(name)
    stored, dimensions = load_policy(Path(name)), load_task(task).action.size
    layers = [key for key in stored if key.startswith("bias_")]
    shape = stored["actions"].shape[-1:] if "actions" in stored else stored[layers[-1]].shape if layers else ()
    if shape != (dimensions,):
        raise ConfigError(f"policy {name}: gives {shape} numbers; accepted: {dimensions}, as {task} takes")


def list_inputs(task: str, name: str) -> list[Any]:
    """Return what an episode depends on besides the code: the task, the materials and the motion."""
    path = bundled_motion(task_name(task)) if name == "recorded" else Path(name)
    motion = name if name in POLICIES and name != "recorded" else read_bytes(path, MAX_ARRAYS).hex()
    laws = [[load_material(base).model_dump(), numbers] for base, numbers in MATERIALS.values()]
    return [load_task(task).model_dump(), laws, digest(motion)]


def write_tables(folder: OutputFolder, name: str, rows_by_task: dict[str, Rows]) -> None:
    """Write index.html, materials.json and .csv, and print the scores."""
    tasks = list(rows_by_task)
    rows: list[dict[str, Any]] = [{"task": task, "material": material, **values} for task in tasks
                                  for material, values in rows_by_task[task].items()]
    folder.write_json("materials.json", {"policy": name, "rows": rows})
    write_rows(folder.path / "materials.csv", rows)
    lines = pivot(tasks, rows_by_task)
    folder.write_text("index.html", make_materials_page(name, rows, lines).html())
    print(aligned(lines))
    print(folder.path / "index.html")


def play_in_material(task: str, name: str, label: str) -> dict[str, Any]:
    """Run an episode from the task's own start; return its score, readings and trajectory.
    The trajectory is the centre [m] (3,) of the observed grains after each action, as long as the simulation does not
    diverge."""
    base, numbers = MATERIALS[label] if label != OWN else (load_task(task).material, {})
    options: dict[str, Any] = {"material": base, **numbers, **training_options(name)}
    made = make(task, **options)
    env = made.unwrapped
    assert isinstance(env, GrainEnv)
    observation, _ = env.reset(seed=0, options={"nominal": True})
    trajectory: list[list[float]] = []

    def follow(step: Transition) -> None:
        if not step.info.get("diverged"):
            trajectory.append(env.world.grains()[:, :3].mean(0).astype(float).tolist())

    _, info = play(env, make_policy(name, env, 0), observation=observation, hooks=[follow])
    made.close()
    diverged = str(info["diverged"]) if info.get("diverged") else None
    return {"score": info["tcs"], "trajectory": trajectory, "diverged": diverged,
            **{key: info["readings"].get(key) for key in READINGS}}


def make_rows(episodes: Rows) -> Rows:
    """Return scores, deviations and readings by material, from episodes by material.
    td_mm: trajectory deviation, the mean distance over the episode [mm] between the centre of the observed grains in
    a material and in the task's own; None where the episode diverged at once."""
    own, rows = np.array(episodes[OWN]["trajectory"]), {}
    for label in MATERIALS:
        trajectory = np.array(episodes[label]["trajectory"])
        common = min(len(own), len(trajectory))  # an episode that diverged is shorter
        deviation = np.linalg.norm(trajectory[:common] - own[:common], axis=1).mean() if common else None
        rows[label] = {"score": episodes[label]["score"], "td_mm": None if deviation is None else 1e3 * deviation,
                       **{key: episodes[label][key] for key in READINGS}, "diverged": episodes[label]["diverged"]}
    return rows


def pivot(tasks: list[str], rows_by_task: dict[str, Rows]) -> list[list[str]]:
    """Return a line for each material under a head: scores of the tasks, with deviations in brackets."""
    def cell(values: dict[str, Any]) -> str:
        deviation = "-" if values["td_mm"] is None else f"{values['td_mm']:.1f}"
        return f"{values['score']:.1f} ({deviation})"

    lines = [["score (TD [mm])", *tasks]]
    return lines + [[material, *(cell(rows_by_task[task][material]) for task in tasks)] for material in MATERIALS]

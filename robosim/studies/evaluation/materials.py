"""`robosim materials`: one motion of each sub-task in materials that it was not learned in."""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from mpm.array_files import MAX_ARRAYS
from robosim.base.digests import code_digest
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.input_files import check_form, read_bytes, read_json
from robosim.base.jobs import Runner, run_jobs
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.base.resources import trained
from robosim.config.materials import load_material
from robosim.dosing import CONTROLLERS
from robosim.envs import is_task_file, task_name
from robosim.randomization.materials import MATERIALS
from robosim.studies.evaluation import POLICIES
from robosim.studies.evaluation.dosing_policy import numbers_of
from robosim.studies.evaluation.material_episode import OWN, READINGS
from robosim.studies.evaluation.material_tables import Rows, draw_map, format_table, make_rows, write_csv
from robosim.studies.evaluation.page import make_materials_page
from robosim.studies.evaluation.policies import load_policy
from robosim.tasks.task import load_task

EPISODES = {"key": str, "episodes": {str: {"score": float, "trajectory": [[float]], "diverged": (str, None),
                                           **dict.fromkeys(READINGS, (float, None))}}}
"""Form of a file of episodes."""
EPISODE = "robosim.studies.evaluation.material_episode"
"""Module that runs one episode."""


def materials(tasks: list[str], out: Path, *, name: str = "learned", jobs: int = 1,
              runner: Runner | None = None) -> int:
    """Run a policy's motion of every task in all materials, and write tables, a picture and a page into a folder.

    Episodes that the folder already has, of the same motion, task and code, are not run again. jobs: processes,
    here; runner: runs the episodes elsewhere.
    Returns 0, or 1 where a process failed; the same command then continues.
    Raises UnknownName for a task that does not exist, ConfigError for a motion that does not fit.
    """
    tasks = list(dict.fromkeys(tasks))
    for task in tasks:
        is_task_file(task)  # raises for a task that does not exist
        check_policy(task, name)
    if len({task_name(task) for task in tasks}) < len(tasks):
        raise ConfigError(f"tasks {', '.join(tasks)}: two have the same name; accepted: files of different names")
    keys = {task: fingerprint(task, name) for task in tasks}
    with OutputFolder(out) as folder:
        episodes = {task: read_episodes(out / f"{task_name(task)}.json", keys[task]) for task in tasks}
        waiting = [(task, label) for task in tasks for label in [OWN, *MATERIALS] if label not in episodes[task]]
        progress = Progress(total=len(tasks) * (1 + len(MATERIALS)), desc="materials", unit="episodes")
        progress.update(progress.total - len(waiting))
        failed = []
        work = [(EPISODE, [task, name, label]) for task, label in waiting]
        for index, episode, reason in run_jobs(work, jobs, runner):
            task, label = waiting[index]
            if episode is None:
                failed.append(f"{task} in {label}: {reason}")
            else:
                episodes[task][label] = episode
                folder.write_json(f"{task_name(task)}.json", {"key": keys[task], "episodes": episodes[task]})
            progress.update()
        progress.close()
        complete = [task for task in tasks if len(episodes[task]) == 1 + len(MATERIALS)]
        if complete:
            write_tables(folder, name, {task_name(task): make_rows(episodes[task]) for task in complete})
    for failure in failed:
        print(f"failed: {failure}; finished episodes are kept, run the same command again to continue", file=sys.stderr)
    return 1 if failed else 0


def check_policy(task: str, name: str) -> None:
    """Raise UnknownName for a policy that does not exist, ConfigError for one that does not fit a task.

    ConfigError, too, for a dosing task: it delivers a mass and no share of the grains.
    """
    if load_task(task).dose is not None:
        raise ConfigError(f"{task}: a dosing task delivers no share of its grains; accepted: a task without a section "
                          f"dose; robosim evaluate {task} --material NAME evaluates a dose in another material")
    if name in POLICIES:
        if name == "learned" and trained(task_name(task)) is None:
            raise ConfigError(f"policy 'learned': there is no bundled motion for {task}")
        if name in CONTROLLERS:
            numbers_of(load_task(task), f"policy {name!r}")
        return
    if not Path(name).is_file():
        raise UnknownName("policy", name, POLICIES, "or the path of a .npz file with `actions`, or with a network")
    stored, dimensions = load_policy(Path(name)), load_task(task).action.size
    layers = [key for key in stored if key.startswith("bias_")]
    shape = stored["actions"].shape[-1:] if "actions" in stored else stored[layers[-1]].shape if layers else ()
    if shape != (dimensions,):
        raise ConfigError(f"policy {name}: gives {shape} numbers; accepted: {dimensions}, as {task} takes")


def fingerprint(task: str, name: str) -> str:
    """Return twelve hexadecimal digits that change with the task, the materials, the motion and the code."""
    path = trained(task_name(task)) if name == "learned" else Path(name)
    motion = read_bytes(path, MAX_ARRAYS).hex() if path is not None and name not in POLICIES[:-1] else name
    laws = [[load_material(base).model_dump(), numbers] for base, numbers in MATERIALS.values()]
    text = json.dumps([load_task(task).model_dump(), laws, motion, code_digest(EPISODE)], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def read_episodes(path: Path, key: str) -> Rows:
    """Read the episodes of an earlier run with the same fingerprint; none where the file cannot be read."""
    try:
        stored = read_json(path)
        check_form(stored, EPISODES)
        return dict(stored["episodes"]) if stored["key"] == key else {}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def write_tables(folder: OutputFolder, name: str, rows_by_task: dict[str, Rows]) -> None:
    """Write index.html, materials.json, .csv and .png, and print the scores."""
    tasks = list(rows_by_task)
    rows: list[dict[str, Any]] = [{"task": task, "material": material, **values} for task in tasks
                                  for material, values in rows_by_task[task].items()]
    folder.write_json("materials.json", {"policy": name, "rows": rows})
    folder.write("materials.csv", lambda path: write_csv(path, rows))
    folder.write("materials.png", lambda path: draw_map(path, tasks, rows_by_task))
    page = make_materials_page(name, rows, (folder.path / "materials.png").read_bytes())
    folder.write_text("index.html", page.html())
    print(format_table(tasks, rows_by_task))
    print(folder.path / "index.html")

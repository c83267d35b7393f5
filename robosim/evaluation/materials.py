"""`robosim materials`: one motion of each sub-task among materials that it was not learnt in."""

import csv
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
import numpy as np  # noqa: E402
from tqdm import tqdm  # noqa: E402

from robosim.config.materials import load_material  # noqa: E402
from robosim.config.output import OutputFolder, aligned  # noqa: E402
from robosim.config.resources import trained  # noqa: E402
from robosim.envs import in_file, make, task_name  # noqa: E402
from robosim.envs.grain_env import GrainEnv  # noqa: E402
from robosim.errors import ConfigError, UnknownName  # noqa: E402
from robosim.evaluation import POLICIES  # noqa: E402
from robosim.evaluation.policies import learnt_with, policy  # noqa: E402
from robosim.reports.jobs import pin, worked_off  # noqa: E402
from robosim.reports.provenance import version_of  # noqa: E402
from robosim.tasks.task import load_task  # noqa: E402

MATERIALS: dict[str, tuple[str, dict[str, float]]] = {
    **{name: (name, {}) for name in ("salt", "sugar", "flour", "sand")},
    "salt, a third of E": ("salt", {"E": 5e4}), "salt, 2.5 times E": ("salt", {"E": 3.75e5}),
    "salt, half as dense": ("salt", {"density": 608.5}), "salt, twice as dense": ("salt", {"density": 2434.0}),
    "salt, 10 deg smoother": ("salt", {"friction_angle_deg": 23.0}),
    "salt, 10 deg rougher": ("salt", {"friction_angle_deg": 43.0}),
    "salt, cohesion 30 Pa": ("salt", {"cohesion": 30.0}), "salt, cohesion 100 Pa": ("salt", {"cohesion": 100.0}),
    "salt, Poisson's ratio 0.35": ("salt", {"nu": 0.35}),
}
"""Thirteen materials, by what tables call them: a material, and numbers in place of its own; none stiffer for its
density than the time step of the sub-tasks allows."""
READINGS = ("delivered", "spilled", "collisions")
OWN = "the task's own"
"""What the trajectory's deviation is from."""


def materials(tasks: list[str], out: Path, *, name: str = "learned", jobs: int = 1) -> int:
    """Play a policy's motion of every task in all materials, from the task's own start; returns 0, or 1 where a process
    ended without an answer. What a folder holds of the same motion, task and code is not played again. Raises
    UnknownName for a task that does not exist, ConfigError for a motion that does not fit.
    """
    tasks = list(dict.fromkeys(tasks))
    for task in tasks:
        in_file(task)  # complains of a task that does not exist
        checked(task, name)
    if len({task_name(task) for task in tasks}) < len(tasks):
        raise ConfigError(f"tasks {', '.join(tasks)}: two of one name; accepted: files of different names")
    folder, keys = OutputFolder(out), {task: fingerprint(task, name) for task in tasks}
    found = {task: earlier(out / f"{task_name(task)}.json", keys[task]) for task in tasks}
    waiting = [(task, called) for task in tasks for called in [OWN, *MATERIALS] if called not in found[task]]
    progress = tqdm(total=len(tasks) * (1 + len(MATERIALS)), unit="episode", file=sys.stderr)
    progress.update(progress.total - len(waiting))
    failed = []
    for place, value, words in worked_off([(__name__, [task, name, called]) for task, called in waiting], jobs):
        task, called = waiting[place]
        if value is None:
            failed.append(f"{task} in {called}: {words}")
        else:
            found[task][called] = value
            folder.write_json(f"{task_name(task)}.json", {"key": keys[task], "played": found[task]})
        progress.update()
    progress.close()
    whole = [task for task in tasks if len(found[task]) == 1 + len(MATERIALS)]
    if whole:
        tell(folder, [task_name(task) for task in whole], name,
             {task_name(task): rows_of(found[task]) for task in whole})
    for words in failed:
        print(f"failed: {words}; what was played is kept, the same command goes on", file=sys.stderr)
    return 1 if failed else 0


def checked(task: str, name: str) -> None:
    """Raise ConfigError, or UnknownName, where a policy is none or does not fit a task."""
    if name in POLICIES:
        if name == "learned" and trained(task_name(task)) is None:
            raise ConfigError(f"policy 'learned': none ships for {task}")
        return
    if not Path(name).is_file():
        raise UnknownName("policy", name, POLICIES, "or the path of a .npz file with `actions`, or with a network")
    learnt_with(name)  # which complains of what cannot be read
    wanted = load_task(task).action.dimensions
    with np.load(name, allow_pickle=False) as stored:
        layers = [key for key in stored if key.startswith("bias_")]
        given = stored["actions"].shape[-1:] if "actions" in stored else stored[layers[-1]].shape if layers else ()
    if given != (wanted,):
        raise ConfigError(f"policy {name}: gives {given} numbers; accepted: {wanted}, as {task} takes")


def fingerprint(task: str, name: str) -> str:
    """Twelve letters that change with the task, the materials, the motion and the code."""
    path = trained(task_name(task)) if name == "learned" else Path(name)
    motion = path.read_bytes().hex() if path is not None and name not in POLICIES[:-1] else name
    laws = [[load_material(base).model_dump(), numbers] for base, numbers in MATERIALS.values()]
    told = json.dumps([load_task(task).model_dump(), laws, motion, version_of(__name__)], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()[:12]


def earlier(path: Path, key: str) -> dict[str, Any]:
    """What an earlier run of the same has played; nothing where that cannot be read."""
    try:
        stored = json.loads(path.read_text())
        return dict(stored["played"]) if stored["key"] == key else {}
    except (OSError, ValueError, TypeError, KeyError):
        return {}


def rows_of(played: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Scores and readings by material. td_mm: mean distance over the episode [mm] between the centre of the observed
    grains there and in the task's own material, the trajectory's deviation; None where it diverged at once."""
    own, rows = np.array(played[OWN]["course"]), {}
    for called in MATERIALS:
        course = np.array(played[called]["course"])
        both = min(len(own), len(course))  # one that diverged has fewer
        deviation = np.linalg.norm(course[:both] - own[:both], axis=1).mean() if both else None
        rows[called] = {"score": played[called]["score"], "td_mm": None if deviation is None else 1e3 * deviation,
                        **{key: played[called][key] for key in READINGS}, "diverged": played[called]["diverged"]}
    return rows


def episode(task: str, name: str, called: str) -> dict[str, Any]:
    """Score and readings of an episode in a material, and the centre of the observed grains after each decision, as far
    as the field held (n, 3) [m]."""
    base, numbers = MATERIALS[called] if called != OWN else (load_task(task).material, {})
    options: dict[str, Any] = {"material": base, **numbers, **learnt_with(name)}
    made = make(task, **options)
    env = made.unwrapped
    assert isinstance(env, GrainEnv)
    env.reset(seed=0, options={"nominal": True})
    act, over, info, course = policy(name, env, 0), False, {}, []
    while not over:
        _, _, terminated, truncated, info = env.step(act())
        over = terminated or truncated
        if not info.get("diverged"):
            course.append(env.world.grains()[:, :3].mean(0).astype(float).tolist())
    made.close()
    return {"score": info["tcs"], "course": course, "diverged": str(info["diverged"]) if info.get("diverged") else None,
            **{key: info["readings"].get(key) for key in READINGS}}


def tell(folder: OutputFolder, tasks: list[str], name: str, found: dict[str, dict[str, dict[str, Any]]]) -> None:
    """Write the tables and the picture, print the scores."""
    rows = [{"task": task, "material": material, **values} for task in tasks
            for material, values in found[task].items()]
    folder.write_json("materials.json", {"policy": name, "rows": rows})
    folder.write("materials.csv", lambda path: as_csv(path, rows))
    folder.write("materials.png", lambda path: draw(path, tasks, found))
    print(as_text(tasks, found))


def as_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """A line for each task and material."""
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def as_text(tasks: list[str], found: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Scores, and deviations in brackets, for a terminal."""
    def cell(values: dict[str, Any]) -> str:
        deviation = "-" if values["td_mm"] is None else f"{values['td_mm']:.1f}"
        return f"{values['score']:.1f} ({deviation})"

    lines = [["score (TD [mm])", *tasks]]
    lines += [[material, *(cell(found[task][material]) for task in tasks)] for material in MATERIALS]
    return aligned(lines)


def draw(path: Path, tasks: list[str], found: dict[str, dict[str, dict[str, Any]]]) -> None:
    """What was delivered, as a map of materials by tasks, with scores."""
    shares = np.array([[found[task][material]["delivered"] for task in tasks] for material in MATERIALS], float)
    figure, axes = plt.subplots(figsize=(2.6 + 1.35 * len(tasks), 1.2 + 0.42 * len(MATERIALS)), constrained_layout=True)
    image = axes.imshow(shares, vmin=0.0, vmax=1.0, cmap="viridis", aspect="auto")
    for i, material in enumerate(MATERIALS):
        for j, task in enumerate(tasks):
            axes.text(j, i, f"{found[task][material]['score']:.1f}", ha="center", va="center", fontsize=8,
                      color="black" if shares[i, j] > 0.6 else "white")
    axes.set_xticks(range(len(tasks)), tasks, rotation=30, ha="right")
    axes.set_yticks(range(len(MATERIALS)), list(MATERIALS))
    axes.set_title("score of one motion; colour: delivered fraction")
    figure.colorbar(image)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main(words: list[str]) -> None:
    """One episode, as JSON on the last line; words: task, policy, material, core."""
    task, name, called, core = words
    pin(core)
    print(json.dumps(episode(task, name, called)))


if __name__ == "__main__":
    main(sys.argv[1:])

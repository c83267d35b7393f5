"""`robosim materials`: one motion of each sub-task among materials that it was not learnt in."""

import csv
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import gymnasium
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
import numpy as np  # noqa: E402
from tqdm import tqdm  # noqa: E402

import robosim.envs  # noqa: E402
from robosim.envs.grain_env import GrainEnv  # noqa: E402
from robosim.envs.policies import policy  # noqa: E402
from robosim.envs.task import load_task  # noqa: E402
from robosim.errors import RobosimError, UnknownName  # noqa: E402
from robosim.materials import load_material  # noqa: E402
from robosim.output import OutputFolder  # noqa: E402
from robosim.reports.processes import pin, worked_off  # noqa: E402
from robosim.resources import trained  # noqa: E402

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
READINGS = ("score", "td_mm", "delivered", "spilled", "collisions")


def materials(tasks: list[str], out: Path, *, name: str = "learned", jobs: int = 1) -> int:
    """Play a policy's motion of every task in all materials, from the task's own start; returns 0. What a folder holds
    of the same motion and task is not played again. Raises RobosimError where a task's process ended without an answer.
    """
    for task in tasks:
        if task not in robosim.envs.TASKS:
            raise UnknownName("task", task, robosim.envs.TASKS)
    folder, found, waiting = OutputFolder(out), {}, []
    for task in tasks:
        key = fingerprint(task, name)
        stored = earlier(out / f"{task}.json")
        if stored.get("key") == key:
            found[task] = stored["materials"]
        else:
            waiting.append((task, key))
    work = [(__name__, [task, name]) for task, _ in waiting]
    progress = tqdm(initial=len(found), total=len(tasks), unit="task", file=sys.stderr)
    failed = []
    for place, value, words in worked_off(work, jobs):
        task, key = waiting[place]
        if value is None:
            failed.append(f"{task}: {words}")
        else:
            found[task] = value
            folder.write_json(f"{task}.json", {"key": key, "materials": value})
        progress.update()
    progress.close()
    if failed:
        raise RobosimError(f"{'; '.join(failed)}; what was played is kept, the same command goes on")
    rows = [{"task": task, "material": material, **values} for task in tasks
            for material, values in found[task].items()]
    folder.write_json("materials.json", {"policy": name, "rows": rows})
    folder.write("materials.csv", lambda path: as_csv(path, rows))
    folder.write("materials.png", lambda path: draw(path, tasks, found))
    print(as_text(tasks, found))
    return 0


def fingerprint(task: str, name: str) -> str:
    """Twelve letters that change with the task, the materials and the motion."""
    path = trained(task) if name == "learned" else Path(name)
    motion = path.read_bytes().hex() if path is not None and path.is_file() else name
    laws = [[load_material(base).model_dump(), numbers] for base, numbers in MATERIALS.values()]
    told = json.dumps([load_task(task).model_dump(), laws, motion], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()[:12]


def earlier(path: Path) -> dict[str, Any]:
    """What an earlier run has left, if it can be read."""
    try:
        return dict(json.loads(path.read_text()))
    except (OSError, ValueError):
        return {}


def played(task: str, name: str, chosen: dict[str, tuple[str, dict[str, float]]]) -> dict[str, dict[str, Any]]:
    """Scores and readings of one motion in materials. td_mm: mean distance over the episode [mm] between the centre of
    the observed grains there and in the task's own material, the trajectory's deviation."""
    own = centres(task, name, load_task(task).material, {})[1]
    rows = {}
    for called, (base, numbers) in chosen.items():
        info, course = centres(task, name, base, numbers)
        both = min(len(own), len(course))  # one that diverged has fewer
        deviation = np.linalg.norm(course[:both] - own[:both], axis=1).mean()
        rows[called] = {"score": info["tcs"], "td_mm": 1e3 * float(deviation),
                        **{key: info["readings"].get(key) for key in READINGS[2:]},
                        "diverged": str(info["diverged"]) if info.get("diverged") else None}
    return rows


def centres(task: str, name: str, base: str, numbers: dict[str, float]) -> tuple[dict[str, Any], np.ndarray]:
    """The last info of an episode, and the centre of the observed grains after each decision (n, 3) [m]."""
    options: dict[str, Any] = {"material": base, **numbers}
    made = gymnasium.make(f"robosim/{task}-v0", **options)
    env = made.unwrapped
    assert isinstance(env, GrainEnv)
    env.reset(seed=0, options={"nominal": True})
    act, over, info, course = policy(name, env, 0), False, {}, []
    while not over:
        _, _, terminated, truncated, info = env.step(act())
        course.append(env.world.grains()[:, :3].mean(0))
        over = terminated or truncated
    made.close()
    return info, np.array(course, float)


def as_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """A line for each task and material."""
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def as_text(tasks: list[str], found: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Scores, and deviations in brackets, for a terminal."""
    lines = [["score (TD [mm])", *tasks]]
    lines += [[material, *(f"{found[task][material]['score']:.1f} ({found[task][material]['td_mm']:.1f})"
                           for task in tasks)] for material in MATERIALS]
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return "\n".join("  ".join(word.ljust(width) for word, width in zip(line, widths)) for line in lines)


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
    """One task in all materials, its rows as JSON on the last line; words: task, policy, core."""
    task, name, core = words
    pin(core)
    print(json.dumps(played(task, name, MATERIALS)))


if __name__ == "__main__":
    main(sys.argv[1:])
